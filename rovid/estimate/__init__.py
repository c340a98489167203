"""Identification: from prepared runs to parameters with their covariance.

Drag and inertia by dedicated runs: `steady_points`, `steady_drag`, `sine_inertia`, `inertia`, `free_decay`;
`thrust_curve` from bench readings. Start of the likelihood fits: `instrumental_variables`, `output_error`. Likelihood:
the data (`dataset`, then `filter_data` for one-step and `multi_step_data` for multi-step predictions), the coordinates
(`parametrization`), the objective (`objective`, with `innovation_likelihood` and `multi_step_likelihood`), its
derivatives (`fisher_information`), the optimiser (`levenberg_marquardt`), the result (`fit_result`), and the fit of all
parameters (`maximum_likelihood`). The next run to make: `candidate_runs`, `experiment_design`.
"""

"""Identification: from prepared runs to parameters with their covariance.

Drag and inertia by dedicated runs: `steady_points`, `steady_drag`, `oscillation_tests`, `inertia`. Actuators:
`thrust_curve` from bench readings, `inner_loop`. Start of the likelihood fits: `output_error`. Likelihood: the data
(`dataset`, then `filter_data` for one-step and `multi_step` for multi-step predictions), the coordinates
(`parametrization`), the objective (`objective`, with `innovation_likelihood` and `multi_step`), its derivatives
(`fisher_information`), the optimiser (`levenberg_marquardt`), the result (`fit_result`), and the fit of all
parameters (`maximum_likelihood`). The next run to make: `candidate_runs`, `experiment_design`.
"""

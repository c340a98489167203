"""All numeric thresholds of the diagnosis: value, unit, decision, origin, and sensitivity.

The text below each value states its unit, what the value decides, how the value was set ("theory", a calibration run,
"convention", or "not recorded"), and what changes where the value is halved or doubled. The direction of the change
follows from the code; no benchmark has measured its size. "Not measured" means that the direction is unknown, too.

Thresholds that the diagnosis shares with `rovid fit` stand with the estimators: `INNOVATIONS_R2` and
`DISTURBANCE_LIMITS` in `rovid.estimate.maximum_likelihood`, the tests of white innovations, and `MIN_INERTIA_SIGMAS`.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """Numeric thresholds of the diagnosis, in the order in which the algorithm applies them."""

    # --- Data that a diagnosis requires -------------------------------------------------------------------------------
    min_trials: int = 4
    """Trials. Fewer are cut into parts. Set: convention. Halved: campaigns of two or three trials are not cut into
    parts; doubled: more campaigns are cut into parts."""
    parts: int = 8
    """Parts. Target number of parts of all recorded time. Set: convention. Halved: longer parts, one for each fold;
    doubled: shorter parts, until `part_time_constants` limits them."""
    part_time_constants: float = 4.0
    """Time constants. Shortest part: the state before the part is then forgotten in most of it. Set: not recorded.
    Halved: more parts depend on their unknown start; doubled: fewer parts, and more campaigns are refused."""
    part_time_constants_min: float = 2.0
    """Time constants. Shortest part where longer ones give fewer than `min_trials`. Set: not recorded. Halved: shorter
    logs are diagnosed; doubled: they are refused."""
    part_cutoff_periods: float = 8.0
    """Periods of the cut-off. Shortest part for the low-pass filter, whose kernel spans 2.5. Set: convention. Halved:
    the filter loses more than half of a part; doubled: fewer parts."""
    part_samples: int = 10
    """Samples. Smallest part. Set: convention (as for a log). Halved or doubled: not measured."""
    pause_periods: float = 100.0
    """Sampling periods. A longer gap between positions divides a trial. Set: convention. Halved: more gaps divide;
    doubled: parts may span longer gaps."""
    motion_over_noise: float = 2.0
    """Ratio. A rate norm below this multiple of its noise is no motion. Set: convention. Halved: noise may pass as
    motion; doubled: slow trials are refused."""

    # --- Computing effort ---------------------------------------------------------------------------------------------
    fork_samples: int = 300_000
    """Samples. Longer logs are diagnosed by threads instead of forked copies. Set: not recorded (memory). Halved or
    doubled: time and memory alone."""
    parallel_fit_samples: int = 400_000
    """Samples. Longer data are fitted one model at a time. Set: not recorded (memory). Halved or doubled: time and
    memory alone."""
    search_tolerance: float = 0.1
    """Nats. Remaining gain at which a fit of the search ends. Set: not recorded. Halved: slower; doubled: BIC
    differences are off by up to 0.2."""
    search_iterations: int = 25
    """Optimiser steps. Most steps of a fit of the search. Set: not recorded. Halved: slow fits may end early; doubled:
    slower."""
    first_iterations: int = 4
    """Optimiser steps. First stage of the candidate fits. Set: not recorded. Halved: good candidates may look poor;
    doubled: slower."""
    second_stage: tuple[float, int] = (0.2, 8)
    """Share of the best gain, optimiser steps. Candidates below the share are left. Set: not recorded. Halved: more
    candidates are fitted further; doubled: fewer."""
    final_stage: tuple[float, int] = (0.4, 25)
    """As `second_stage`, for the fit to convergence."""
    further_forms_share: float = 0.5
    """Share of the predicted gain of the best form. All forms of a leading cause with more are fitted. Set: score tests
    are good to a factor of a few. Halved: more fits; doubled: the right form of a large effect may not be fitted."""
    reach_rounds: int = 2
    """Rounds of `final_stage` for fits that may still reach the best one. Set: convention. Halved: fits that converge
    slowly are compared too early; doubled: slower."""
    goal_distance: float = 50.0
    """Nats. A candidate fit ends where it cannot come within this distance of the best. Set: not recorded. Halved:
    faster, and BIC gains of poor alternatives are less exact; doubled: slower."""
    start_shares: tuple[float, ...] = (1.0, 0.3, 0.1)
    """Shares of the step of the score test from which a candidate fit may start. Set: not recorded. Halved or doubled:
    fits start nearer to or farther from zero."""
    start_share_limits: tuple[float, float] = (0.1, 5.0)
    """Smallest and largest size of the start of a candidate fit, in sizes of its initial value. Set: not recorded.
    Halved or doubled: fits start nearer to or farther from zero, where the linearisation is better or worse."""
    full_data_tolerance: float = 0.05
    """Nats. Remaining gain at which a fit to all data ends. Set: not recorded. Halved or doubled: as there."""
    close_iterations: int = 20
    """Optimiser steps. Fits that start next to their solution (effect size, trial outlier, waves). Set: not recorded.
    Halved: such fits may end early; doubled: slower."""

    # --- Screening by score tests -------------------------------------------------------------------------------------
    shortlist_share: float = 0.1
    """Share of the best predicted gain. Causes below are not fitted. Set: not recorded. Halved: more fits; doubled: a
    cause may be missed where its score test predicts too little."""
    shortlisted_causes: int = 7
    """Causes. Most causes fitted in one round; all are, if the plain model fits poorly. Set: not recorded. Halved:
    faster, causes are missed; doubled: slower."""
    shortlisted_forms: int = 3
    """Forms. Most forms fitted for each shortlisted cause, besides simpler ones. Set: not recorded. Halved or doubled:
    as `shortlisted_causes`."""
    screening_share: float = 0.4
    """Share of the gain that an addition needs. One-step objective: forms with less predicted gain are not fitted. Set:
    not recorded. Halved: more fits; doubled: causes with too small a prediction are missed."""
    substitute_share: float = 0.05
    """Share of the gain lost without an effect. Forms with less predicted gain are not tried in its place. Set: score
    tests are good to a factor of a few. Halved: more fits; doubled: alternatives may be missed."""

    # --- Which objective decides --------------------------------------------------------------------------------------
    thinning_time_constants: float = 0.035
    """Time constants. Interval between the samples that a one-step search uses: three readings in a lag of a tenth of
    the time constant. Set: convention. Halved: slower; doubled: fast effects (delay, lag) lose information."""
    thinning_samples: float = 2.0
    """Sampling intervals. Data are not thinned to shorter intervals. Set: not recorded. Halved: not measured; doubled:
    coarse logs are not thinned."""
    wave_samples: int = 6000
    """Samples. Enough for the wave test and for the first screening. Set: not recorded. Halved: faster, and weak waves
    are missed; doubled: slower."""
    wave_thinning_time_constants: float = 0.1
    """Time constants. Upper limit of the interval between those samples. Set: not recorded. Halved or doubled: as
    above."""
    score_test_factor: float = 3.0
    """Ratio. A one-step search is given up without fits only where gains larger by this factor would not help. Set:
    score tests are good to a factor of a few. Halved: searches are given up that would succeed; doubled: slower."""
    thinning_ratio: float = 4.0
    """Ratio. Screen the thinned data first where the search data are so many times more. Set: not recorded. Halved or
    doubled: time alone, unless the two screenings disagree."""
    dominant_share: float = 0.3
    """Share of the missing log-likelihood. A one-step search from no effect ends where the best cause gains less. Set:
    not recorded. Halved: the one-step search decides more often; doubled: multi-step predictions do."""
    whitening_causes: int = 3
    """Causes. Largest number of further causes that may jointly explain what is missing. Set: not recorded. Halved:
    one-step searches end earlier; doubled: later."""
    whitening_share: float = 0.25
    """Share of the missing log-likelihood that these causes must gain. Set: not recorded. Halved: later end; doubled:
    earlier end."""
    adequacy_iterations: int = 8
    """Optimiser steps. One-step fit from a multi-step solution, to test for white innovations. Set: not recorded.
    Halved: adequate models may look inadequate; doubled: slower."""
    min_predictions: float = 2.0
    """Independent predictions. With fewer, no cause is searched. Set: convention. Halved or doubled: affects logs that
    are hardly longer than a time constant."""
    reweighting_models: int = 6
    """Models. Candidates that set the correlation of prediction errors. Set: not recorded. Halved: fewer predictions
    may count; doubled: more may."""
    reweighting_growth: float = 1.2
    """Ratio. The multi-step search ends where fewer additional predictions count. Set: not recorded. Halved: the search
    ends only where fewer predictions count than before; doubled: it ends sooner."""

    # --- Stepwise selection -------------------------------------------------------------------------------------------
    bic_margin: float = 6.0
    """Nats. An effect must gain this much, plus ln(causes tried), beyond its BIC penalty. Set: not recorded. Halved:
    more false additions reach validation; doubled: weak causes are missed."""
    misspecification_share: float = 0.04
    """Share of the gain of the effects in the model. A further effect must gain more, because equations are
    approximate. Set: not recorded. Halved: more stand-ins; doubled: weak second causes are missed."""
    misspecification_cap_white: float = 100.0
    """Nats. Upper limit of that allowance with white innovations. Set: not recorded. Halved or doubled: affects models
    that gain more than 1250 or 5000."""
    misspecification_cap: float = 300.0
    """Nats. The same with coloured innovations. Set: not recorded. Halved or doubled: likewise, 3750 or 15000."""
    misspecification_share_signal: float = 0.1
    """Share. Replaces `misspecification_share` next to a signal regressor. Set: not recorded. Halved or doubled: as
    there."""
    exchange_gain: float = 0.5
    """Nats. A replacement must gain this much. Set: not recorded. Halved: models that differ by no more than the
    tolerance of the fits are exchanged; doubled: fewer exchanges."""
    hopeless_share: float = 0.125
    """Share of the budget. The search ends then if the plain model explains next to nothing of the motion. Set: an
    answer in 10 s of 60. Halved: causes of such logs are not found; doubled: the answer takes 20 s."""
    max_effects: int = 6
    """Effects. Largest model, and most rounds of the search. Set: convention. Halved: fourth and later causes are not
    found; doubled: slower."""
    max_screenings: int = 12
    """Screenings. A search with more models screened is cut short and says so. Set: three causes take about seven.
    Halved: more searches are cut short; doubled: slower."""
    paired_causes: int = 6
    """Causes. A model that fits poorly is also extended by pairs of its best causes. Set: not recorded. Halved: fewer
    pairs; doubled: four times as many fits."""
    signal_handicap: float = 6.0
    """Nats. A signal regressor must gain this much more than the best named effect. Set: not recorded. Halved: signals
    are chosen more often; doubled: less often."""
    signal_handicap_share: float = 0.05
    """Share of the gain of the named effect, added to `signal_handicap`. Set: not recorded. Halved or doubled:
    likewise."""

    # --- Final challenge ----------------------------------------------------------------------------------------------
    max_challenges: int = 3
    """Rounds. Most replacements of the selected set by a better one before the tests. Set: convention. Halved: a search
    that starts badly may stay there; doubled: slower."""
    challenger_share: float = 0.3
    """Share of the log-likelihood lost without some effects. Forms that recover less by linearisation are not fitted in
    their place. Set: score tests are good to a factor of a few. Halved: slower; doubled: better sets may be missed."""
    challenging_forms: int = 12
    """Forms. Most forms that are fitted in the place of the same effects, by their predicted gain. Set: effort. Halved:
    faster; doubled: slower."""
    challenging_causes: int = 10
    """Causes. Pairs of the best single causes challenge the selected set. Set: convention. Halved: fewer pairs;
    doubled: four times as many."""
    challenging_pairs: int = 10
    """Pairs. Most pairs that are fitted, by the sum of their gains. Set: effort. Halved: faster; doubled: slower."""
    challengers_shown: int = 3
    """Sets. Challengers of the result. Set: convention. Halved or doubled: the report alone."""

    # --- Comparison of multi-step and one-step effect sizes -----------------------------------------------------------
    consistent_share: float = 0.7
    """Ratio. An effect is dropped if its one-step size is below this share of its multi-step size, and
    `consistent_errors` agrees. Set: not recorded. Halved: effects that feedback imitates stay; doubled: true effects
    are dropped."""
    consistent_errors: float = 2.0
    """Joint standard errors. Difference of the two sizes from which an effect is dropped. Set: convention. Halved: more
    effects are dropped; doubled: fewer."""

    # --- Validation ---------------------------------------------------------------------------------------------------
    cv_folds: int = 4
    """Folds of the cross-validation. Set: convention. Halved: less data in each fit; doubled: slower."""
    cv_iterations: int = 8
    """Optimiser steps in each fold, from the fit to all data. Set: not recorded. Halved: held-out gains are optimistic;
    doubled: slower."""
    cv_tolerance: float = 0.2
    """Nats. Remaining gain at which a fit of a fold ends. Set: not recorded. Halved: slower; doubled: less exact."""
    cv_indifference: float = 1e-6
    """Nats. An effect that changes the fit of a fold by less is set to zero there. Set: rounding. Halved or doubled:
    nothing."""
    min_held_out_gain: float = 0.0
    """Nats. An effect must gain more on trials that were not fitted. Set: theory (cross-validation). Cannot be halved
    or doubled."""
    held_out_growth: float = 0.02
    """Ratio less one. An effect is dropped that makes the errors on held-out trials larger by more, as a mean over the
    pieces. Set: 200 predictions count at most (`docs/method.md`), and an RMS of 200 has an error of 5 %, of which two
    models on the same predictions share more than nine tenths. Halved: true effects whose gain is in the noise are
    dropped; doubled: stand-ins that predict worse stay."""
    changed_time_constant: float = 2.0
    """Factor. An effect that changes the time constant by more must improve the simulation of trials that were not
    fitted. Set: decision; the published inertias of one vehicle differ by as much. Halved: true effects are dropped
    where the disturbance is larger than their influence; doubled: exchanged time constants stay."""
    sampling_share: float = 0.1
    """Share of the sampling interval. An effect that changes the simulated rate by less than a shift by it is dropped.
    Set: decision; interpolation, stamps and integration have errors of this size. Errors of a
    simulator's steps reached 0.06 of an interval, true effects 0.5 or more. Halved: some of those errors become causes;
    doubled: no change in these campaigns."""
    held_share: float = 0.9
    """Share of the thrust that an effect takes away. Friction that holds the vehicle does the same from here on. Set:
    decision; the threshold of a switch has an error. Halved: more effects are dropped next to friction; doubled: no
    effect is."""
    acting_share: float = 0.1
    """Share of the time of a log. A cause between two instants hardly acts in a log up to here. Set: decision; the
    instants have an error. Halved: fewer causes count as those of one or two logs; doubled: more."""
    sampling_change: float = 0.05
    """Share of the RMS rate. The change of the rate in a sampling interval counts as this much at most: an effect of
    half a percent of the rate is never too small. Set: decision, below the 3 % of a visible cause. Halved or doubled:
    only logs of a few samples in a time constant are affected."""
    held_out_growth_level: float = 0.05
    """Level of the one-sided t test of that growth over the pieces. Set: convention (5 %). Halved: stand-ins that
    predict worse stay; doubled: true effects are dropped for one piece that goes wrong."""
    disturbance_growth: float = 2.0
    """Standard errors. An effect that leaves a disturbance larger by more is dropped. Set: convention (5 %). Halved:
    effects are dropped by chance; doubled: stand-ins stay."""
    min_standard_errors: float = 3.5
    """Standard errors. Smaller effects are dropped (one-step objective). Set: not recorded. Halved: more false effects;
    doubled: weak effects are dropped."""
    min_standard_errors_multi_step: float = 3.0
    """The same for multi-step predictions, which count as few. Set: not recorded. Halved or doubled: likewise."""
    min_standard_errors_suspect: float = 1.0
    """Standard errors. Smaller effects are no suspects. Set: convention. Halved: more suspects; doubled: fewer."""
    min_stated_errors: float = 3.0
    """Standard errors, as stated: with other forms, suspects and torques that the model lacks. Smaller effects are
    suspects at most. Set: convention. Halved: more false effects; doubled: weak effects are dropped."""
    established: float = 0.95
    """Probability. A cause is established from here on. It must stay below `max_probability`. Set: convention;
    `docs/hard.md` counts 98 % right. Halved: likely causes are stated as established; doubled: impossible."""
    max_suspect_probability: float = 0.94
    """Probability. No suspect is more certain. Set: below `established`. Halved: no suspect is likely; doubled:
    impossible."""
    likely: float = 0.5
    """Probability. An effect below `established` is called likely from here on, and stays in the model until validation
    ends. Set: convention (even odds). Halved: more effects stay; doubled: none does."""
    possible: float = 0.2
    """Probability. A less probable cause is not reported. Set: convention. Halved: more suspects; doubled: fewer."""
    confirmed_standard_errors: float = 5.0
    """Standard errors. The size of a confirmed cause is at least as far from nothing. Set: theory; chance gives a
    Gaussian size of 5 errors in 6 of 10 million tests, and in 1 of 10 000 diagnoses of 200 forms. Halved: chance
    confirms one cause in every diagnosis; doubled: weak causes are likely at most."""
    confirmed_odds: float = 99.0
    """Odds of a true cause against a stand-in at the held-out gain of a confirmed cause. Set: a rate of 1 in 100.
    Halved: one confirmed cause in 50 at that gain is a stand-in; doubled: one in 200."""
    likely_standard_errors: float = 3.0
    """Standard errors. The size of a likely cause is at least as far from nothing. Set: convention, that of an
    established cause. Halved: likely causes may be nothing; doubled: most suspects are possible at most."""
    max_rejections: int = 6
    """Rejections. Most bans in one validation; the model after the last one is tested again only if likely effects are
    dropped. Set: convention. Halved: more effects stay untested; doubled: slower."""
    tie_margin: float = 6.0
    """Nats. Causes with a smaller difference of BIC gain are not distinguishable. Set: not recorded. Halved: sharper
    verdicts, more of them wrong; doubled: more causes are named together."""
    tie_share: float = 0.03
    """Share of the BIC gain, added to `tie_margin`. Set: not recorded; in 60 simulated campaigns no rival of a cause is
    within 4 %. Halved or doubled: as there."""
    tie_cap: float = 40.0
    """Nats. Upper limit of that addition. Set: not recorded. Halved or doubled: affects gains above 670 or 2700."""
    tie_full_data_share: float = 0.8
    """Share of the BIC gain. Alternatives above are compared on all data. Set: not recorded. Halved: slower; doubled:
    ties of thinned data are not resolved."""
    tie_full_data_alternatives: int = 2
    """Alternatives compared on all data. Set: not recorded. Halved: the second best alternative cannot win; doubled:
    slower."""
    max_tie_decisions: int = 3
    """Replacements of an effect by a better alternative in one pass. Set: convention. Halved or doubled: not
    measured."""

    # --- Posterior probability ----------------------------------------------------------------------------------------
    prior_odds: float = 1.0
    """Odds that any further cause acts, shared by all causes tried. Set: convention (even). Halved: a cause needs 0.7
    nats more; doubled: 0.7 nats less."""
    max_probability: float = 0.97
    """Probability. No cause of one campaign is more certain. Set: not recorded; calibration campaigns find 1.00 right.
    Halved: nothing is established; doubled: impossible."""
    stand_in_gain: float = 6.0
    """Nats. Held-out gain at which a stand-in for a missing equation is as frequent as a true cause. Set: hard-water
    campaigns. Halved: 3 nats less establish a cause; doubled: 6 more."""
    stand_in_scale: float = 4.7
    """Nats. Further gain that multiplies the odds by e. Set: hard-water campaigns. Halved: 13 nats establish a cause
    instead of 20; doubled: 34."""
    stand_in_scale_white: float = 2.35
    """The same with white innovations. Set: not recorded. Halved: 9.5 nats establish a cause instead of 13; doubled:
    20."""
    recalibration_offset: float = 0.85
    """Log odds added to a probability with coloured innovations. Set: hard water, seeds 404, 505, 606; held out: 707.
    Halved: stated odds are a factor 1.5 lower; doubled: a factor 2.3 higher."""
    recalibration_slope: float = 0.75
    """Factor on the log odds. Set: likewise. Halved: probabilities move to the middle; doubled: to 0 and 1."""
    suspect_margin: float = math.log(10.0)
    """Nats. An alternative with a tenth of the odds of a suspect is distinguishable from it. Set: convention. Halved:
    fewer causes share a suspect; doubled: more."""
    stand_in_share: float = 0.5
    """Share of the gain. A suspect that keeps less next to a better cause, which one-step predictions exclude, stands
    in for that cause and is not reported. Set: convention (half). Halved: more suspects; doubled: fewer."""
    thrust_scatter: float = 0.05
    """Share. Usual difference of thrust between trials. Set: convention. Halved: smaller outliers are reported;
    doubled: only larger ones."""
    thrust_scatter_trials: int = 2
    """Trials. Weight of that prior knowledge. Set: convention. Halved or doubled: not measured."""

    # --- Waves --------------------------------------------------------------------------------------------------------
    wave_first_iterations: int = 3
    """Optimiser steps of each start of the wave fit. Set: not recorded. Halved or doubled: time, and the start
    chosen."""
    wave_starts: int = 3
    """Starts of the wave fit. Set: not recorded. Halved or doubled: likewise."""
    wave_disturbance_shares: tuple[float, ...] = (0.01, 0.1, 1.0)
    """Shares of the RMS torque from which the disturbance of the wave fit may start. Set: convention. Halved or
    doubled: not measured."""
    wave_disturbance_times: tuple[float, ...] = (0.15, 2.0)
    """Time constants. Correlation times from which it may start. Set: convention. Halved or doubled: not measured."""

    # --- Result -------------------------------------------------------------------------------------------------------
    equivalent_form_share: float = 0.9
    """Share of the gain. With coloured innovations, forms above have equal weight in the covariance. Set: not recorded.
    Halved: wider standard errors; doubled: narrower."""
    nested_model_causes: int = 3
    """Causes. Up to here all combinations are simulated. Set: convention. Halved or doubled: figures of the report
    alone."""

    # --- Tables of sine trials ----------------------------------------------------------------------------------------
    table_p_value: float = 0.05
    """Probability. A model with a smaller p-value does not explain the tables. Set: convention. Halved: more models
    explain them; doubled: fewer."""
    table_reading_digits: float = 0.5
    """Last digits. Standard deviation of a printed rate. Set: convention. Halved: chi-square is four times as large;
    doubled: a quarter."""
    table_slowest_share: float = 0.05
    """Share of the fastest rate. A slower hold settles in no longer time. Set: convention. Halved or doubled: duration
    of the simulation alone."""
    table_inertia_ratios: tuple[float, float] = (1.0, 4.0)
    """Ratios to the rigid-body inertia between which an explanation may lie. Set: a closed hull full of water has 4.
    Halved or doubled: other explanations are allowed."""

    def tie(self, bic_gain: float) -> float:
        """Difference of BIC gain in nats from which a cause with ``bic_gain`` is distinguishable from another."""
        # Part of any gain belongs to the form of the equation, which is approximate even where innovations are white.
        return self.tie_margin + min(self.tie_share * bic_gain, self.tie_cap)


THRESHOLDS = Thresholds()
# Probabilities that other rooms use to word a finding.
ESTABLISHED, POSSIBLE = THRESHOLDS.established, THRESHOLDS.possible

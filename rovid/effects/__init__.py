"""Physical effects beyond inertia and drag; see `rovid.effects.catalogue`."""

from rovid.effects.base import Effect, EffectParameter
from rovid.effects.catalogue import (
    ANGLE_FORMS,
    CATALOGUE,
    EFFECTS,
    FORMS,
    PLANAR_EFFECTS,
    PLANAR_FORMS,
    SYNONYMS,
    TERM_EFFECTS,
    TERMS,
    effect_named,
    every_form,
    forms_for,
    in_angles,
    load_plugins,
    restoring_effect,
    term_effect,
    term_kind,
)

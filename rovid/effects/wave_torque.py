"""Torque of waves: narrow-band, of random phase, independent of the command."""

from rovid.effects.base import Effect, EffectParameter, WaveTorque

# Over the time constant of the vehicle; a fit leaves out those below one cycle of the longest run and above the Nyquist
# frequency. A narrow band has an effect only near its frequency, so many initial values are needed.
_FREQUENCIES = tuple(0.05 * 1.4**k for k in range(24))
# Damping of the widest spectrum of a sea, that of Pierson and Moskowitz (Fossen 2011, section 8.2).
SEA_DAMPING = 0.26

EFFECT: Effect = Effect(
    id="wave_torque",
    environmental=True,
    title="wave torque",
    parameters=(
        # Amplitude of a sine with the same power: root 2 times the standard deviation.
        EffectParameter(name="amplitude", unit="N m", high=2.0, initial_values=(0.05,), scale="torque"),
        EffectParameter(
            name="frequency",
            unit="rad/s",
            neutral=1.0,
            low=0.02,
            high=200.0,
            initial_values=_FREQUENCIES,
            scale="one/time",
        ),
        # Half the bandwidth over the frequency, for white noise through a second-order filter (Fossen 2011, section
        # 8.2).
        EffectParameter(name="damping", unit="1", neutral=1e-8, low=1e-8, high=0.5, initial_values=(0.04,)),
    ),
    equation="+ w, a narrow-band torque about ω of standard deviation a/√2",
    fingerprint="a peak in the spectrum of the residual, not coherent with the command, also present at rest",
    experiment="a record at rest without command; the same run deeper",
    rivals=("tank_seiche",),
    acts=WaveTorque(),
)
FORMS: tuple[Effect, ...] = (EFFECT,)

"""Inertia and cross-flow drag of a hull from its dimensions: a prior with a wide error.

The added masses are those of an ellipsoid with the hull's dimensions in an ideal fluid (Lamb 1932, articles 114 and
115; Newman 1977, chapter 4). At the surface, and at low frequencies, the ellipsoid is the hull with its mirror image:
the hull is half of it. The cross-flow drag is the strip integral of a constant section (Fossen 2011, section 6.4.3).
"""

import math
from dataclasses import dataclass

# kg/m^3. Fresh water; sea water is within the errors.
_DENSITY = 1000.0


@dataclass(frozen=True, kw_only=True)
class Hull:
    """A hull that is symmetric fore and aft."""

    length: float  #: m.
    beam: float  #: m.
    depth: float  #: m; of a hull at the surface its draught, of a submerged one its height.
    submerged: bool
    mass: float | None = None  #: kg; None for that of the displaced ellipsoid.
    yaw_inertia: float | None = None  #: kg m^2, of the rigid body; None for that of an ellipsoid.
    drag_coefficient: float = 1.0  #: Of the sections across the flow.

    def parameters(self) -> dict[str, float]:
        """Inertias with added mass, and the quadratic drags of sway and yaw, in SI."""
        from scipy.special import elliprd

        a, b = 0.5 * self.length, 0.5 * self.beam
        c = 0.5 * self.depth if self.submerged else self.depth
        # Lamb's integrals alpha_0 and beta_0 by Carlson's.
        alpha = 2.0 / 3.0 * a * b * c * float(elliprd(b * b, c * c, a * a))
        beta = 2.0 / 3.0 * a * b * c * float(elliprd(a * a, c * c, b * b))
        displaced = self.mass or _DENSITY * (4.0 if self.submerged else 2.0) / 3.0 * math.pi * a * b * c
        rigid = self.yaw_inertia or displaced * (a * a + b * b) / 5.0
        difference, total = a * a - b * b, a * a + b * b
        divisor = 2.0 * difference - total * (beta - alpha)
        added = 0.2 * difference**2 * (beta - alpha) / divisor if difference else 0.0
        across = 0.5 * _DENSITY * self.drag_coefficient * self.depth * self.length
        return {
            "surge.inertia": displaced * (1.0 + alpha / (2.0 - alpha)),
            "sway.inertia": displaced * (1.0 + beta / (2.0 - beta)),
            "yaw.inertia": rigid + displaced * added,
            "sway.quadratic_drag": across,
            "yaw.quadratic_drag": across * self.length**3 / 32.0,
        }

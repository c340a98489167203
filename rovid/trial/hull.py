"""Inertia and cross-flow drag of a hull from its dimensions, with a wide error.

The added masses are those of an ellipsoid with the hull's dimensions in an ideal fluid (Lamb 1932, articles 114 and
115; Newman 1977, chapter 4). At the surface, and at low frequencies, the ellipsoid is the hull with its mirror image:
the hull is half of it. The cross-flow drag is the strip integral of a constant section (Fossen 2011, section 6.4.3).
"""

import math

# kg/m^3 of fresh water; sea water is within the errors of what is computed with it.
WATER_DENSITY = 1000.0


def cross_flow_drags(length: float, depth: float, drag_coefficient: float) -> tuple[float, float]:
    """Quadratic drag in sway, N s^2/m^2, and in yaw, N m s^2, of a hull with sections of one ``depth`` in m.

    With the half density times depth and coefficient k: k times the ``length`` L in m in sway, and the integral of
    k |x|^3 over the length in yaw, k L^4/32.
    """
    sway = 0.5 * WATER_DENSITY * drag_coefficient * depth * length
    return sway, sway * length**3 / 32.0


def hull_parameters(
    length: float,
    beam: float,
    depth: float,
    drag_coefficient: float = 1.0,
    mass: float | None = None,
    yaw_inertia: float | None = None,
    *,
    submerged: bool,
) -> dict[str, float]:
    """Inertias with added mass, and the quadratic drags of sway and yaw, in SI.

    ``depth`` is the height in m of a ``submerged`` hull, or else the draught; the other dimensions are in m. ``mass``
    in kg and ``yaw_inertia`` in kg m^2 are those of the rigid body; None for those of the displaced ellipsoid.
    """
    from scipy.special import elliprd

    a, b, c = 0.5 * length, 0.5 * beam, 0.5 * depth if submerged else depth
    # Lamb's integrals alpha_0 and beta_0 by Carlson's.
    alpha = 2.0 / 3.0 * a * b * c * float(elliprd(b * b, c * c, a * a))
    beta = 2.0 / 3.0 * a * b * c * float(elliprd(a * a, c * c, b * b))
    displaced = mass or WATER_DENSITY * (4.0 if submerged else 2.0) / 3.0 * math.pi * a * b * c
    difference, total = a * a - b * b, a * a + b * b
    divisor = 2.0 * difference - total * (beta - alpha)
    turning = 0.2 * difference**2 * (beta - alpha) / divisor if difference else 0.0
    sway_drag, yaw_drag = cross_flow_drags(length, depth, drag_coefficient)
    return {
        "surge.inertia": displaced * (1.0 + alpha / (2.0 - alpha)),
        "sway.inertia": displaced * (1.0 + beta / (2.0 - beta)),
        "yaw.inertia": (yaw_inertia or 0.2 * displaced * total) + turning * displaced,
        "sway.quadratic_drag": sway_drag,
        "yaw.quadratic_drag": yaw_drag,
    }

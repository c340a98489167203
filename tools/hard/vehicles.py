"""Five vehicles, in the orders of size that such vehicles publish; each campaign draws its own of the kind."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tools.hard.layout import (
    ARM,
    BACKWARD,
    COS,
    CROSS_FLOW,
    DL,
    DQ,
    EXPONENT,
    FORWARD,
    LENGTH,
    LOSS,
    M11,
    M22,
    M23,
    M33,
    N_HULL,
    N_THRUSTER,
    N_UR,
    N_UV,
    PLACE_X,
    PLACE_Y,
    POD,
    SIN,
    X_U,
    X_UU,
    Y_V,
    Y_VV,
    ZONE_BACKWARD,
    ZONE_FORWARD,
    Floats,
)  # fmt: skip


@dataclass(frozen=True)
class Thruster:
    """Where a thruster sits, which way it pushes, what the bench says of it. Angles go from ahead to starboard."""

    name: str
    x: float
    y: float
    angle: float  # rad
    forward: float  # N at full command
    backward: float
    zone: tuple[float, float] = (0.05, 0.05)  # dead zone ahead and astern, of full command
    exponent: float = 2.0
    pod_angle: float = 0.0  # rad at full command; above 0 the command is an angle and `forward` the pull
    yaw: float = 0.0  # share in the demand in yaw
    surge: float = 0.0  # share in the demand ahead
    listed: bool = True  # in rovid.toml; one that does not turn the vehicle need not be

    @property
    def arm(self) -> float:
        """Torque over thrust, m."""
        return self.x * float(np.sin(self.angle)) - self.y * float(np.cos(self.angle))

    def row(self, loss: float) -> Floats:
        """What the compiled code takes."""
        row = np.zeros(N_THRUSTER)
        row[[POD, COS, SIN, PLACE_X, PLACE_Y]] = (
            self.pod_angle, 0.0 if self.pod_angle else np.cos(self.angle), np.sin(self.angle), self.x, self.y,
        )  # fmt: skip
        row[[ARM, FORWARD, BACKWARD, EXPONENT, LOSS]] = self.arm, self.forward, self.backward, self.exponent, loss
        row[[ZONE_FORWARD, ZONE_BACKWARD]] = self.zone
        return row


@dataclass(frozen=True)
class Vehicle:
    """A kind of vehicle: hull, thrusters, the units of its commands, how it is run and logged."""

    key: str
    name: str
    mass: float
    length: float
    width: float
    added: tuple[float, float, float]  # of surge, sway, yaw
    inertia: float  # rigid body
    centre: float  # of gravity ahead of the origin, m
    surge_drag: tuple[float, float]
    sway_drag: tuple[float, float]
    yaw_drag: tuple[float, float]  # linear, quadratic
    cross_flow: float  # share of the quadratic yaw drag that the strips make
    sideslip: float  # N_uv: what fins and skegs take back of the Munk moment
    turning_at_speed: float  # N_ur
    thrusters: tuple[Thruster, ...]
    unit: str
    neutral: float
    span: float
    fineness: float  # steps of the command between neutral and full
    rate_in_use: float  # rad/s
    cruise: tuple[float, float]  # demand ahead, least and most
    sample_rate: tuple[float, float]  # Hz
    rotor_share: float  # time constant of the rotors, of the vehicle's
    loss: float  # nominal, to advance speed; the bench curve lacks it
    surface: bool
    wind: bool

    @property
    def total_inertia(self) -> float:
        """Of yaw with the sway that goes along: what turning alone feels, kg m^2."""
        m23 = self.mass * self.centre
        return self.inertia + self.added[2] - m23 * m23 / (self.mass + self.added[1])

    @property
    def time_constant(self) -> float:
        """Of yaw at the rate in use, s."""
        linear, quadratic = self.yaw_drag
        return self.total_inertia / (linear + 2.0 * quadratic * self.rate_in_use)

    @property
    def torque_in_use(self) -> float:
        """That the rate in use needs, N m."""
        linear, quadratic = self.yaw_drag
        return linear * self.rate_in_use + quadratic * self.rate_in_use**2

    def hull(self) -> Floats:
        """What the compiled code takes."""
        hull = np.zeros(N_HULL)
        hull[[M11, M22, M23, M33]] = (
            self.mass + self.added[0], self.mass + self.added[1], self.mass * self.centre, self.inertia + self.added[2],
        )  # fmt: skip
        hull[[X_U, X_UU]] = self.surge_drag
        hull[[Y_V, Y_VV]] = self.sway_drag
        hull[[DL, DQ]] = self.yaw_drag
        hull[CROSS_FLOW] = 32.0 * self.cross_flow * self.yaw_drag[1] / self.length**4
        hull[[N_UV, N_UR, LENGTH]] = self.sideslip, self.turning_at_speed, self.length
        return hull

    def varied(self, rng: np.random.Generator) -> Vehicle:
        """Another vehicle of the kind."""

        def some(value: float, spread: float = 0.2) -> float:
            return float(value * np.exp(rng.uniform(-spread, spread)))

        thrust = some(1.0, 0.15)
        ratio = some(1.0, 0.1)
        exponent = float(rng.uniform(1.75, 2.1))
        thrusters = tuple(
            replace(
                one, forward=one.forward * thrust, backward=one.backward * thrust * (1.0 if one.pod_angle else ratio),
                zone=(some(one.zone[0], 0.4), some(one.zone[1], 0.4)), exponent=exponent,
            )
            for one in self.thrusters
        )  # fmt: skip
        return replace(
            self,
            added=(some(self.added[0]), some(self.added[1]), some(self.added[2])),
            inertia=some(self.inertia, 0.1),
            surge_drag=(some(self.surge_drag[0]), some(self.surge_drag[1])),
            sway_drag=(some(self.sway_drag[0]), some(self.sway_drag[1])),
            yaw_drag=(some(self.yaw_drag[0], 0.5), some(self.yaw_drag[1], 0.3)),
            sideslip=some(self.sideslip, 0.15),
            turning_at_speed=some(self.turning_at_speed, 0.5),
            cross_flow=float(rng.uniform(0.4, 1.0)),
            thrusters=thrusters,
            rotor_share=some(self.rotor_share, 0.4),
        )


_HALF = float(np.pi / 2)
_QUARTER = float(np.pi / 4)

WORK = Vehicle(
    key="work", name="work-class ROV, 3 m", mass=3200.0, length=2.9, width=1.7, added=(2000.0, 3600.0, 2300.0),
    inertia=2900.0, centre=0.04, surge_drag=(120.0, 1500.0), sway_drag=(180.0, 1100.0), yaw_drag=(260.0, 4200.0),
    cross_flow=0.7, sideslip=-1200.0, turning_at_speed=40.0,
    thrusters=(
        Thruster("fore", 1.1, 0.0, _HALF, 900.0, 700.0, (0.05, 0.06), yaw=1.0),
        Thruster("aft", -1.1, 0.0, -_HALF, 900.0, 700.0, (0.05, 0.06), yaw=1.0),
        Thruster("axial_port", -0.9, -0.5, 0.0, 1000.0, 800.0, surge=1.0, listed=False),
        Thruster("axial_starboard", -0.9, 0.5, 0.0, 1000.0, 800.0, surge=1.0, listed=False),
    ),
    unit="V", neutral=0.0, span=10.0, fineness=500.0, rate_in_use=0.18, cruise=(0.0, 0.2), sample_rate=(5.0, 10.0),
    rotor_share=0.02, loss=0.04, surface=False, wind=False,
)  # fmt: skip
INSPECTION = Vehicle(
    key="inspection", name="inspection ROV, 0.75 m", mass=34.0, length=0.75, width=0.55, added=(14.0, 28.0, 1.3),
    inertia=2.1, centre=0.01, surge_drag=(6.0, 38.0), sway_drag=(8.0, 60.0), yaw_drag=(0.9, 3.2), cross_flow=0.6,
    sideslip=-10.0, turning_at_speed=0.25,
    thrusters=(
        Thruster("fore_port", 0.22, -0.2, _QUARTER, 22.0, 17.0, (0.07, 0.08), yaw=1.0, surge=1.0),
        Thruster("fore_starboard", 0.22, 0.2, -_QUARTER, 22.0, 17.0, (0.07, 0.08), yaw=-1.0, surge=1.0),
        Thruster("aft_port", -0.22, -0.2, -_QUARTER, 22.0, 17.0, (0.07, 0.08), yaw=1.0, surge=1.0),
        Thruster("aft_starboard", -0.22, 0.2, _QUARTER, 22.0, 17.0, (0.07, 0.08), yaw=-1.0, surge=1.0),
    ),
    unit="us", neutral=1500.0, span=400.0, fineness=400.0, rate_in_use=0.65, cruise=(0.0, 0.2),
    sample_rate=(10.0, 20.0), rotor_share=0.05, loss=0.04, surface=False, wind=False,
)  # fmt: skip
BOAT = Vehicle(
    key="boat", name="twin-screw surface vehicle, 1.6 m", mass=42.0, length=1.6, width=0.9, added=(4.0, 30.0, 5.0),
    inertia=8.5, centre=0.0, surge_drag=(6.0, 22.0), sway_drag=(90.0, 60.0), yaw_drag=(7.0, 9.0), cross_flow=0.7,
    sideslip=-21.0, turning_at_speed=0.4,
    thrusters=(
        Thruster("port", -0.6, -0.36, 0.0, 36.0, 28.0, (0.06, 0.07), yaw=1.0, surge=1.0),
        Thruster("starboard", -0.6, 0.36, 0.0, 36.0, 28.0, (0.06, 0.07), yaw=-1.0, surge=1.0),
    ),
    unit="-1..1", neutral=0.0, span=1.0, fineness=250.0, rate_in_use=0.4, cruise=(0.25, 0.65), sample_rate=(5.0, 15.0),
    rotor_share=0.03, loss=0.02, surface=True, wind=True,
)  # fmt: skip
SHIP = Vehicle(
    key="ship", name="ship model with two azimuth pods, 7 m", mass=3270.0, length=7.0, width=1.27,
    added=(160.0, 2900.0, 7600.0), inertia=10000.0, centre=0.05, surge_drag=(12.0, 60.0), sway_drag=(2500.0, 500.0),
    yaw_drag=(1500.0, 13000.0), cross_flow=0.8, sideslip=-2330.0, turning_at_speed=60.0,
    thrusters=(
        Thruster("pod_port", -3.2, -0.35, -_HALF, 20.0, 20.0, (0.0, 0.0), pod_angle=0.6, yaw=1.0),
        Thruster("pod_starboard", -3.2, 0.35, -_HALF, 20.0, 20.0, (0.0, 0.0), pod_angle=0.6, yaw=1.0),
        Thruster("main", -3.4, 0.0, 0.0, 150.0, 80.0, surge=1.0, listed=False),
    ),
    unit="deg", neutral=0.0, span=float(np.degrees(0.6)), fineness=344.0, rate_in_use=0.03, cruise=(0.0, 0.5),
    sample_rate=(2.0, 4.0), rotor_share=0.03, loss=0.0, surface=True, wind=True,
)  # fmt: skip
LAUNCH = Vehicle(
    key="launch", name="survey launch with bow and stern tunnel, 12 m", mass=14000.0, length=12.0, width=3.6,
    added=(900.0, 9500.0, 75000.0), inertia=125000.0, centre=0.1, surge_drag=(250.0, 400.0),
    sway_drag=(1500.0, 3000.0), yaw_drag=(26000.0, 190000.0), cross_flow=0.8, sideslip=-6500.0, turning_at_speed=2000.0,
    thrusters=(
        Thruster("bow", 4.6, 0.0, _HALF, 1900.0, 1700.0, (0.06, 0.06), yaw=1.0),
        Thruster("stern", -4.2, 0.0, -_HALF, 1900.0, 1700.0, (0.06, 0.06), yaw=1.0),
        Thruster("main", -5.5, 0.0, 0.0, 6000.0, 3500.0, surge=1.0, listed=False),
    ),
    unit="%", neutral=0.0, span=100.0, fineness=200.0, rate_in_use=0.11, cruise=(0.0, 0.2), sample_rate=(4.0, 10.0),
    rotor_share=0.03, loss=0.01, surface=True, wind=True,
)  # fmt: skip

VEHICLES = {vehicle.key: vehicle for vehicle in (WORK, INSPECTION, BOAT, SHIP, LAUNCH)}

"""Slew mechanics: load pressure to angle, with dry friction that truly sticks.

    J dw/dt     = A r PL - b w - tau_f - tau_load               (4.1)-(4.6), (4.27), (4.28)
      dtheta/dt = w
    tau_f = level(w) sign(w) while moving; at rest it balances the rest, up to level(0)
          = level(w) tanh(w/omega_v) where friction is said to build up with speed
          = sigma0 z + sigma1 dz/dt, dz/dt = w - |w| sigma0 z/level(w), where it builds up over a distance (LuGre; Canudas de
            Wit et al., IEEE Trans. Automatic Control 40(3), 1995), with sigma0 = level(0)/z_s and sigma1 = sqrt(sigma0 J)

Ends of the travel clamp the angle and take the speed into them: theta_min <= theta <= theta_max.

Within a step the pressure moves on a straight line from its previous to its new value. Sliding phases are exact for
that; the instants at which the motion stops or breaks away are located inside the step. Friction that builds up is that
of the step's mean speed.
"""

import math
import sys
from typing import Annotated, NamedTuple

from fmus.contract import Block, NoMemory, Variable, equation, slot
from fmus.linear import phi_functions
from fmus.motion import slid, slide, stopped, stopping_time


class Input(NamedTuple):
    """What comes in."""

    p_load: Annotated[float, Variable("Pa", "Load pressure", low=-1e9, high=1e9, display="bar", nominal=1e5)]


class Output(NamedTuple):
    """What goes out."""

    theta: Annotated[float, Variable("rad", "Slew angle", display="deg")]
    omega: Annotated[float, Variable("rad/s", "Slew velocity", display="deg/s", nominal=0.01)]


class State(NamedTuple):
    """Angle, velocity, the driving torque at the end of the last step, and the deflection of friction's bristles."""

    theta: Annotated[float, Variable("rad", "Slew angle", display="deg")]
    omega: Annotated[float, Variable("rad/s", "Slew velocity", display="deg/s", nominal=0.01)]
    torque: Annotated[float, Variable("N.m", "Driving torque A r PL", nominal=1e3)]
    bristle: Annotated[float, Variable("rad", "Deflection over which friction has built up", nominal=1e-5)]


class Parameters(NamedTuple):
    """Inertia, friction, geometry."""

    J: Annotated[float, Variable("kg.m2", "Inertia at the slew axis", 763.9437268410978, 1e-12, 1e9, nominal=1e3, source="(4.34): 7.5e-6 in deg and bar mm3")]  # fmt: skip
    b: Annotated[float, Variable("N.m.s/rad", "Viscous friction", 26661.636066754313, 0.0, 1e9, nominal=1e4, source="(5.12): pole at 34.9 rad/s (SYSTEM section 9.1), b = 34.9 J")]  # fmt: skip
    A: Annotated[float, Variable("m2", "Cylinder area", 8.4193e-3, 1e-9, 100.0, display="mm2", nominal=1e-2, source="Table 3.1; SYSTEM section 9.3")]  # fmt: skip
    r: Annotated[
        float, Variable("m", "Pinion radius", 0.1, 1e-6, 100.0, display="mm", nominal=0.1, source="Table 3.1")
    ]
    tau_c: Annotated[float, Variable("N.m", "Coulomb friction torque", 0.0, 0.0, 1e9, nominal=100.0, source="(4.27); nominal none")]  # fmt: skip
    omega_v: Annotated[float, Variable("rad/s", "Speed over which dry friction builds up; 0: it truly sticks", 0.0, 0.0, 1e3, display="deg/s", nominal=1e-3, source="off: sign(theta') of (4.27)")]  # fmt: skip
    z_s: Annotated[float, Variable("rad", "Deflection over which dry friction builds up; 0: it truly sticks", 0.0, 0.0, 1.0, display="deg", nominal=1e-5, source="off: sign(theta') of (4.27)")]  # fmt: skip
    tau_load: Annotated[float, Variable("N.m", "Constant load torque against positive motion", 0.0, -1e9, 1e9, nominal=100.0, source="(4.27); nominal none")]  # fmt: skip
    theta_0: Annotated[float, Variable("rad", "Angle at the start", 0.0, -1e9, 1e9, display="deg", source="starts where the log does")]  # fmt: skip
    omega_0: Annotated[float, Variable("rad/s", "Velocity at the start", 0.0, -1e3, 1e3, display="deg/s", nominal=0.01, source="starts at rest")]  # fmt: skip
    theta_min: Annotated[float, Variable("rad", "Lower end of the travel; -1e9 rad is out of reach", -1e9, -1e9, 1e9, display="deg", source="off: the nominal crane has no end in reach")]  # fmt: skip
    theta_max: Annotated[float, Variable("rad", "Upper end of the travel; 1e9 rad is out of reach", 1e9, -1e9, 1e9, display="deg", source="off: the nominal crane has no end in reach")]  # fmt: skip


class Coefficients(NamedTuple):
    """Exact response over the step to a torque on a straight line.

    omega1 = w_w omega0 + w_0 torque0 + w_1 torque1;  theta1 = theta0 + t_w omega0 + t_0 torque0 + t_1 torque1;
    phi1, phi2, phi3 of the whole step are for dry friction.
    """

    h: float
    J: float
    w_w: float
    w_0: float
    w_1: float
    t_w: float
    t_0: float
    t_1: float
    phi1: float
    phi2: float
    phi3: float


@slot("chain")
def inertia(J: float, p: Parameters) -> float:
    """Inertia that the drive moves directly, kg m2; effects that split it off act here."""
    return J


@slot("sum")
def load_torque(
    s: float, theta: float, omega: float, x: State, m: NoMemory, p: Parameters, c: Coefficients
) -> float:
    """Torque against positive motion, N m, at angle theta and velocity omega; effects add theirs.

    Called at the start (s = 0) and, with predicted angle and velocity, at the end (s = 1) of a step.
    """
    return p.tau_load


@slot("sum")
def friction_level(omega: float, m: NoMemory, p: Parameters) -> float:
    """Magnitude of the dry friction torque at speed omega, N m; effects add theirs."""
    return p.tau_c


@slot("chain")
def seen_angle(theta: float, m: NoMemory, p: Parameters) -> float:
    """Angle that sensor and tracker see, rad; effects such as backlash act here."""
    return theta


@slot("chain")
def seen_velocity(omega: float, theta: float, m: NoMemory, p: Parameters) -> float:
    """Velocity of what sensor and tracker see, rad/s, at angle theta."""
    return omega


@slot("chain")
def joint_angle(theta: float, before: float, p: Parameters) -> float:
    """Angle after a step that began at `before`, rad; effects on the transmission between drive and joint act here."""
    return theta


@equation
def static_friction(m: NoMemory, p: Parameters) -> tuple[float, float]:
    """Torques between which dry friction holds at rest, N m: no less than what it takes from the motion that would begin."""
    holding = friction_level(0.0, m, p)
    if holding > 0.0:
        return -max(holding, friction_level(-1e-12, m, p)), max(holding, friction_level(1e-12, m, p))
    return 0.0, 0.0


@equation
def with_dry_friction(theta: float, omega: float, t0: float, t1: float, m: NoMemory, p: Parameters, c: Coefficients) -> tuple[float, float]:  # fmt: skip
    """Angle and velocity after the step with dry friction, phase by phase: sliding, stopping, sticking, breaking away."""
    left = c.h
    decay, phi1, phi2, phi3 = c.w_w, c.phi1, c.phi2, c.phi3
    for _ in range(8):
        slope = (t1 - t0) / left
        direction = math.copysign(1.0, omega)
        if omega == 0.0:
            low, high = static_friction(m, p)
            if low <= t0 <= high:
                if low <= t1 <= high:
                    return theta, 0.0
                # stuck until the torque reaches what friction can hold
                goal = high if t1 > high else low
                dt = (goal - t0) / slope
                t0 = goal
                left = left - dt
                if left <= 0.0:
                    return theta, 0.0
            direction = math.copysign(1.0, t0 if t0 > high or t0 < low else t1)
        if left != c.h:
            decay, phi1, phi2, phi3 = phi_functions(p.b * left / c.J)
        level = direction * friction_level(omega, m, p)
        _, ahead = slid(theta, omega, t0 - level, t1 - level, left, c.J, decay, phi1, phi2, phi3)
        # midpoint: second order where it varies; of the motion as it goes, though it stops on the way
        level = direction * friction_level(direction * abs(0.5 * (omega + ahead)), m, p)
        angle, speed = slid(theta, omega, t0 - level, t1 - level, left, c.J, decay, phi1, phi2, phi3)
        if speed * direction >= 0.0:
            return angle, speed
        dt = stopping_time(omega, direction, t0 - level, slope, left, c.J, p.b)
        theta, _ = slide(theta, omega, t0 - level, t0 - level + slope * dt, dt, c.J, p.b)
        omega = 0.0
        t0 = t0 + slope * dt
        left = left - dt
        if left <= 1e-12 * c.h:
            return theta, 0.0
    return theta, omega


@equation
def with_smooth_friction(
    omega: float, t0: float, t1: float, m: NoMemory, p: Parameters, c: Coefficients
) -> float:
    """Friction torque at the mean speed of the step, N m, where it builds up with speed (A-stable)."""
    _, free = slid(0.0, omega, t0, t1, c.h, c.J, c.w_w, c.phi1, c.phi2, c.phi3)
    half = 0.5 * c.h / c.J * c.phi1  # mean speed lost per torque
    goal = 0.5 * (omega + free)
    low, high = min(0.0, goal), max(0.0, goal)
    level = half * friction_level(omega, m, p)
    # nearer to rest than the solution: from there Newton's steps do not overshoot
    mean = math.copysign(max(abs(goal) / (1.0 + level / p.omega_v), abs(goal) - level), goal)
    for _ in range(60):
        level = half * friction_level(mean, m, p)
        rise = math.tanh(mean / p.omega_v)
        miss = mean + level * rise - goal
        if miss > 0.0:
            high = mean
        else:
            low = mean
        change = miss / (1.0 + level * (1.0 - rise * rise) / p.omega_v)
        mean = mean - change
        if abs(change) <= 1e-5 * p.omega_v:
            break  # quadratic convergence: the error is now of the order 1e-10
        if mean <= low or mean >= high:
            mean = 0.5 * (low + high)
    return (goal - mean) / half


@equation
def with_bristles(omega: float, z: float, t0: float, t1: float, m: NoMemory, p: Parameters, c: Coefficients) -> tuple[float, float]:  # fmt: skip
    """Mean friction torque of the step, N m, and the bristles' deflection at its end, rad, at the mean speed of the step."""
    _, free = slid(0.0, omega, t0, t1, c.h, c.J, c.w_w, c.phi1, c.phi2, c.phi3)
    half = 0.5 * c.h / c.J * c.phi1
    goal = 0.5 * (omega + free)
    holding = friction_level(0.0, m, p)
    sigma0 = holding / p.z_s
    sigma1 = math.sqrt(sigma0 * c.J) / c.h
    side = 1.0 if half * sigma0 * z < goal else -1.0
    low, high = 0.0, abs(goal) + half * (sigma0 + sigma1) * abs(z)
    speed, end = 0.0, z
    for _ in range(60):
        # bristles need a level to reach, however far it falls with speed
        most = side * p.z_s * max(friction_level(speed, m, p) / holding, 1e-6)
        rate = c.h / abs(most)
        way = rate * speed
        decay, phi1, bend = 1.0 - way, 1.0 - 0.5 * way, 0.5  # bend = phi1 - phi2
        if way > 1e-6:
            decay = math.exp(-way)
            phi1 = -math.expm1(-way) / way
            bend = (phi1 - decay) / way
        end = most + (z - most) * decay
        drag = sigma0 * (most + (z - most) * phi1) + sigma1 * (end - z)
        miss = speed + side * (half * drag - goal)
        if miss > 0.0:
            high = speed
        else:
            low = speed
        slope = side * (most - z) * rate * (sigma0 * bend + sigma1 * decay)
        change = miss / (1.0 + half * slope)
        speed = speed - change
        if abs(change) <= 1e-5 * abs(goal) + 1e-15:
            break
        if speed <= low or speed >= high:
            speed = 0.5 * (low + high)
    return (goal - side * speed) / half, end


@equation
def start(u: Input, p: Parameters) -> State:
    """At the start angle, nominally at rest."""
    theta, omega = stopped(p.theta_0, p.omega_0, p.theta_min, p.theta_max)
    return State(theta, omega, p.A * p.r * u.p_load, 0.0)


@equation
def coefficients(p: Parameters, h: float) -> Coefficients:
    """Exact response over the step h, s."""
    J = inertia(p.J, p)
    decay, phi1, phi2, phi3 = phi_functions(p.b * h / J)
    k = h / J
    return Coefficients(
        h,
        J,
        decay,
        k * (phi1 - phi2),
        k * phi2,
        h * phi1,
        h * k * (phi2 - phi3),
        h * k * phi3,
        phi1,
        phi2,
        phi3,
    )


@equation
def driven(
    x: State, torque: float, drag: float, m: NoMemory, p: Parameters, c: Coefficients
) -> tuple[float, float]:
    """Angle and velocity after the step up to a driving torque, against a drag that stays as it is."""
    t0 = x.torque - drag - load_torque(0.0, x.theta, x.omega, x, m, p, c)
    ahead = c.w_w * x.omega + (c.w_0 + c.w_1) * t0
    t1 = torque - drag - load_torque(1.0, x.theta + c.h * x.omega, ahead, x, m, p, c)
    return (
        x.theta + c.t_w * x.omega + c.t_0 * t0 + c.t_1 * t1,
        c.w_w * x.omega + c.w_0 * t0 + c.w_1 * t1,
    )


@equation
def step(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> State:
    """(4.27) over one step of length c.h."""
    torque = p.A * p.r * u.p_load
    holding = friction_level(0.0, m, p)
    if holding > 0.0:
        t0 = x.torque - load_torque(0.0, x.theta, x.omega, x, m, p, c)
        drag = max(-holding, min(holding, t0))
        if p.z_s > 0.0:
            drag = holding / p.z_s * x.bristle
        elif p.omega_v > 0.0:
            drag = friction_level(x.omega, m, p) * math.tanh(x.omega / p.omega_v)
        elif x.omega != 0.0:
            drag = math.copysign(friction_level(x.omega, m, p), x.omega)
        ahead = c.w_w * x.omega + (c.w_0 + c.w_1) * (t0 - drag)
        if ahead * x.omega < 0.0:
            ahead = 0.0  # it stops on the way
        t1 = torque - load_torque(1.0, x.theta + c.h * x.omega, ahead, x, m, p, c)
        bristle = 0.0
        if p.z_s > 0.0 or p.omega_v > 0.0:
            if p.z_s > 0.0:
                drag, bristle = with_bristles(x.omega, x.bristle, t0, t1, m, p, c)
            else:
                drag = with_smooth_friction(x.omega, t0, t1, m, p, c)
            theta, omega = slid(x.theta, x.omega, t0 - drag, t1 - drag, c.h, c.J, c.w_w, c.phi1, c.phi2, c.phi3)  # fmt: skip
        else:
            theta, omega = with_dry_friction(x.theta, x.omega, t0, t1, m, p, c)
        theta, omega = stopped(joint_angle(theta, x.theta, p), omega, p.theta_min, p.theta_max)
        return State(theta, omega, torque, bristle)
    theta, omega = driven(x, torque, 0.0, m, p, c)
    theta, omega = stopped(joint_angle(theta, x.theta, p), omega, p.theta_min, p.theta_max)
    return State(theta, omega, torque, 0.0)


@equation
def output(x: State, u: Input, m: NoMemory, p: Parameters) -> Output:
    """What sensor and tracker see."""
    return Output(seen_angle(x.theta, m, p), seen_velocity(x.omega, x.theta, m, p))


# In model exchange. The motion is 0.0: held at rest by friction or by an end of the travel; 1.0 or -1.0: free, in this
# direction, the sense of dry friction. It changes at events only. 1e-12 rad and rad/s and 1e-9 N m are below anything that
# matters: by so much an indicator is away from zero where a motion begins, since a host looks for its next change of sign.


@equation
def pushing(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> float:
    """Torque without friction at rest, N m."""
    return p.A * p.r * u.p_load - load_torque(0.0, x.theta, x.omega, x, m, p, c)


@equation
def sticking(m: NoMemory, p: Parameters) -> float:
    """Torque up to which dry friction holds, N m; none where friction builds up with speed."""
    if p.omega_v > 0.0:
        return 0.0
    return friction_level(0.0, m, p)


@equation
def held_between(x: State, m: NoMemory, p: Parameters) -> tuple[float, float]:
    """Torques between which friction and the ends of the travel hold it at rest, N m."""
    low, high = 0.0, 0.0
    if sticking(m, p) > 0.0:
        low, high = static_friction(m, p)
    if x.theta <= p.theta_min:
        low = -1e12
    if x.theta >= p.theta_max:
        high = 1e12
    return low, high


@equation
def motion_from(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients) -> float:
    """The motion that begins in this state."""
    if x.omega != 0.0:
        return math.copysign(1.0, x.omega)
    push = pushing(x, u, m, p, c)
    low, high = held_between(x, m, p)
    if low + 1e-9 < push < high - 1e-9:
        return 0.0
    return math.copysign(1.0, push)


@equation
def after_event(x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients, motion: float) -> State:
    """The state after an event: at rest where friction stopped the motion or an end of the travel took its speed."""
    omega = x.omega
    if motion == 0.0 or (sticking(m, p) > 0.0 and motion * omega < 0.0):
        omega = 0.0
    theta, omega = stopped(x.theta, omega, p.theta_min, p.theta_max)
    return State(theta, omega, x.torque, x.bristle)


@equation
def indicators(
    x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients, motion: float
) -> tuple[float, float, float]:
    """Numbers that an event makes negative: torques left until it breaks away, or speed and angles left until it stops."""
    if motion == 0.0:
        push = pushing(x, u, m, p, c)
        low, high = held_between(x, m, p)
        return high - push, push - low, 1.0
    speed = 1.0
    if sticking(m, p) > 0.0:
        speed = motion * x.omega + 1e-12
    return speed, p.theta_max - x.theta + 1e-12, x.theta - p.theta_min + 1e-12


@equation
def step_without_event(
    x: State, u: Input, m: NoMemory, p: Parameters, c: Coefficients, motion: float
) -> State:
    """(4.27) over a step of length c.h in which the motion stays as it is."""
    torque = p.A * p.r * u.p_load
    if motion == 0.0:
        return State(x.theta, 0.0, torque, 0.0)
    speed = motion * max(motion * x.omega, 1e-12)  # a host may look a little beyond the event
    drag = motion * friction_level(speed, m, p)
    if p.omega_v > 0.0:
        drag = friction_level(x.omega, m, p) * math.tanh(x.omega / p.omega_v)
    theta, omega = driven(x, torque, drag, m, p, c)
    return State(joint_angle(theta, x.theta, p), omega, torque, 0.0)


BLOCK = Block(
    name="mechanical",
    title="Slew mechanics: load pressure to angle",
    module=sys.modules[__name__],
    reads={"p_load": "line"},
    helpers=(phi_functions, slide, slid, stopping_time, stopped),
)

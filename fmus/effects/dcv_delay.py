"""Transport delay between command and spool."""

from fmus.contract import Buffer, Effect, Free, Variable, equation


@equation
def delay_remember(x, x1, u, m, p, c):
    """Put the demand into the ring of past demands; place of the newest, steps in it, and the demand tau_d ago.

    Between two samples the delayed demand is their mean weighted by how long each holds within the step. Of a delay of more
    steps than the ring has places, a place holds the mean of several.
    """
    lag = p.tau_d / c.h
    each = int(lag / 4092.0) + 1
    count = int(m.delay_count) + 1
    i = int(m.delay_index)
    if count > each:
        count = 1
        i = i + 1
        if i >= 4096:
            i = 0
    if count == 1:
        m.delay_ring[i] = u.demand
    else:
        m.delay_ring[i] = m.delay_ring[i] + (u.demand - m.delay_ring[i]) / count
    lag = (lag - count - 0.5 * (each - 1)) / each + 1.0
    n = int(lag)
    part = lag - n
    a = i - n
    if a < 0:
        a += 4096
    b = a - 1
    if b < 0:
        b += 4096
    return float(i), float(count), (1.0 - part) * m.delay_ring[a] + part * m.delay_ring[b]


@equation
def delay_begin(x, u, p):
    """Nothing demanded before the start."""
    return 0.0, 0.0, 0.0


@equation
def delay_demand(demand, m, p):
    """The demand of tau_d ago."""
    return m.delay_demand


EFFECT = Effect(
    name="dcv.delay",
    text="The spool follows the command a fixed time later.",
    residual="spool error proportional to the spool's speed at low frequency; its phase grows in proportion to frequency",
    source="UDP link and valve electronics (SYSTEM section 1); transport delay exp(-tau_d s)",
    key="tau_d",
    parameters={
        "tau_d": Variable(
            "s",
            "Transport delay of the demand",
            0.0,
            0.0,
            5.0,
            display="ms",
            nominal=0.01,
            source="off: no delay in (4.16)",
        )
    },
    free={"tau_d": Free(starts=(0.005, 0.02, 0.05), scale=0.015, floor=0.0005)},
    fills={"delayed_demand": delay_demand},
    memory={
        "delay_index": Variable("1", "Position of the newest demand in the ring"),
        "delay_count": Variable("1", "Steps whose mean is at this position"),
        "delay_demand": Variable("1", "Demand of tau_d ago"),
        "delay_ring": Buffer(4096, "Past demands"),
    },
    begin=delay_begin,
    remember=delay_remember,
)

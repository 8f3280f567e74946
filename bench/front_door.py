"""The front door of flights: what navigation costs a flight of `Entry`."""

import statistics
import time

import measuring

from marsedl.fly import Below, Entry, Error, Markov, Normal, Senses, ThroughDrag, fly

FLIGHTS = 2048
CAPSULE = Entry(ballistic_coefficient=Normal(115.0, 2.0), lift_to_drag=0.24, variation=Markov(0.06, 5e3))
START = {"altitude_km": 125.0, "velocity": Normal(5500.0, 3.0), "flight_path_angle_deg": Normal(-14.2, 0.03)}
SENSES = Senses(
    altitude=Error(bias=Normal(0.0, 200.0), noise=20.0),
    velocity=Error(scale=Normal(1.0, 1e-3), walk=0.1),
    drag=Error(scale=Normal(1.0, 5e-3)),
    density=ThroughDrag(115.0),
)
NOTE = "Median ratio of CPU times of flights that take turns; the same law, with and without senses; our own target."


def law(velocity, drag):
    """Bank angle from the drag."""
    return 1.2 - 0.005 * (drag - 50.0 * (velocity / 4000.0) ** 2)


def measure(row):
    """Rows of the speed with and without senses."""

    def flown(senses):
        options = {"trigger": Below("velocity", 480.0), "end_time": 420.0, "trials": FLIGHTS}
        began = time.process_time()
        fly(CAPSULE, START, law=law, senses=senses, **options)
        return time.process_time() - began

    pairs = [(flown(None), flown(SENSES)) for _ in range(measuring.FLIGHT_REPETITIONS + 1)][1:]
    without, with_senses = (statistics.median(times) for times in zip(*pairs, strict=True))
    row(f"{FLIGHTS:,} flights of an entry, drawn and counted", FLIGHTS / without, "trials per CPU s")
    row(f"{FLIGHTS:,} flights of an entry with senses, drawn and counted", FLIGHTS / with_senses, "trials per CPU s")
    ratio = statistics.median(sensing / not_sensing for not_sensing, sensing in pairs)
    row("time of flights with senses over that without", ratio, "ratio", below=1.15, note=NOTE)

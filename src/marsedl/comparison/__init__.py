"""What the papers say beside each other: comparisons that none of them could make, from the artifacts of all.

A comparison is a module of this package. For every paper it has a function of the paper's name, from the paper's inputs
and artifacts to a common record, and two functions of the records of all papers: `figure` and `table`.
"""

from dataclasses import dataclass, field, replace
from functools import cache

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.code_digest import SOURCE_ROOT, remembered_digests
from marsedl.replication.declarations import Taken, taken_by


@dataclass(frozen=True)
class Comparison:
    """One figure and one table: their captions, and by paper what the function of its name takes.

    A function that takes `measured` is given the paper's rows of data/reference/benchmarks.csv.
    """

    figure: str
    table: str
    takes: dict[str, Taken] = field(default_factory=dict)

    @property
    def needs(self) -> dict[str, tuple[str, ...]]:
        """The artifacts that are compared, by paper."""
        return {paper: taken.needs + taken.optional for paper, taken in self.takes.items()}

    @property
    def measured(self) -> bool:
        """Whether it shows run times."""
        return any("measured" in taken.others for taken in self.takes.values())

    @property
    def papers(self) -> tuple[str, ...]:
        """The papers that are compared."""
        return tuple(self.takes)


COMPARISONS = {
    "densities": Comparison(
        "Density models of the papers. Left: mean density relative to that of the random-field paper, with its spread, "
        "thick over the altitudes that the nominal flies. Right: how far a density may be from that mean. These are "
        "different things: one standard deviation of a Gaussian variation that changes with altitude (random field and "
        "stochastic entry), the largest value of a bounded one that is constant in a flight (funnels), and a constant "
        "error that the paper does not have and that is flown here beyond it (desensitized). The powered descent has "
        "no atmosphere: its dispersion comes from the start and from noise on the thrust.",
        "Mean density relative to that of the random-field paper and its dispersion, at five altitudes.",
    ),
    "trajectories": Comparison(
        "Altitude against velocity: the nominal of every paper, and dots of its first Monte Carlo flights. Left the "
        "four entries, right all five down to the ground on logarithmic axes. Velocities are relative to the planet, "
        "which does not rotate in the random-field and the desensitized paper. No paper flies from the parachute's "
        "deployment to the start of the powered descent, nor do the papers land the same vehicle.",
        "The nominals: both ends, lowest altitude and duration.",
    ),
    "accuracy": Comparison(
        "Standard deviation at the end of the flight: linear covariance over Monte Carlo, in every paper, with three "
        "standard errors of the Monte Carlo; on the right what is near one. Below one, linear covariance promises less "
        "than the flights scatter. It is furthest off for the laws that are designed to null the linear sensitivity "
        "(desensitized), since what is left of their errors is not linear. The flights of the stochastic entry also "
        "have errors of lift, drag, azimuth and crossrange and reverse their bank, which its linear model leaves out. "
        "The funnels paper has no covariance: its linear model is applied here to the starts and disturbances that its "
        "flights draw, uniform on the boundaries of their sets.",
        "Final standard deviations by linear covariance and over the flights, their ratio, and its standard error from "
        "the number of flights and the fourth moments. Flights that were lost are left out of the sample.",
    ),
    "costs": Comparison(
        "Size and cost of the methods: unknowns and conditions of one problem, time of the design, of one Monte Carlo "
        "flight, and of everything that is made for the paper. Sizes are those of the artifacts; times were measured "
        "on one machine and are kept in data/reference/benchmarks.csv. A flight is timed in the kernel, in strict C "
        "with the same bits, and in array code.",
        "Size and cost of the methods. Unknowns and conditions are of one problem, as the artifacts hold them; a "
        "solver may add its own. Iterations are of all problems.",
    ),
}


@cache
def comparisons() -> dict[str, Comparison]:
    """Return the comparisons by name, with what their functions take."""
    digests = remembered_digests(SOURCE_ROOT.parent)
    functions = digests.functions(__name__)
    found = {}
    for stem, written in COMPARISONS.items():
        takes = {}
        for slug in SLUGS:
            entry = f"{__name__}.{stem}:{slug}"
            if entry in functions:
                stages, parameters = catalogue(slug).stages, functions[entry]["parameters"]
                takes[slug] = taken_by(entry, parameters, input_model(slug), stages, digests)
        found[stem] = replace(written, takes=takes)
    return found

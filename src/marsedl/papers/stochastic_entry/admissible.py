"""What every universe of the paper has to fulfil: its nominal flight is as the text describes it."""

from marsedl.papers.stochastic_entry.records import Nominal
from marsedl.replication.errors import InadmissibleError

REVERSALS = 3  # Sec. V, text on Fig. 5
UPRANGE = (5.0e3, 15.0e3)  # m; Sec. V prints 10 km


def admissible(nominal: Nominal) -> None:
    """Raise InadmissibleError unless the nominal has three reversals and ends 5 to 15 km uprange of the target."""
    uprange = -float(nominal.downrange[-1])
    if len(nominal.reversal_time) != REVERSALS or not UPRANGE[0] <= uprange <= UPRANGE[1]:
        raise InadmissibleError(
            f"the nominal has {len(nominal.reversal_time)} reversals and ends {uprange / 1e3:.1f} km uprange; "
            f"the paper describes {REVERSALS} and about 10 km"
        )

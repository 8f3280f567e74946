"""Partitions of time, as the configuration and the stages check them; imports nothing, as the former is read often."""

from itertools import pairwise
from math import floor, gcd


def partition_fault(nodes, final_time):
    """What is wrong with a partition, in words that name the nodes; empty if nothing is."""
    if nodes[0] != 0.0:
        return f"begins at {nodes[0]:g}, must begin at 0"
    for index, (earlier, later) in enumerate(pairwise(nodes)):
        if not later > earlier:
            return f"does not increase: node {index} is {earlier:g} and node {index + 1} is {later:g}"
    if nodes[-1] != final_time:
        return f"ends at {nodes[-1]:g}, must end at the final time, {final_time:g}"
    return ""


def with_halved_end_steps(nodes, time_step):
    """The partition with its first and last interval halved, to whole integration steps."""
    middles = (sum(interval) / 2 for interval in (nodes[:2], nodes[-2:]))
    return sorted({*nodes, *(round(middle / time_step) * time_step for middle in middles)})


def steps_between_outputs(nodes, time_step, longest):
    """Integration steps from one stored state to the next: the most that divide every interval and last no longer.

    nodes: s, whole numbers of time_step. longest: s, at least one step.
    """
    shared = gcd(*(round(node / time_step) for node in nodes))
    most = max(floor(longest / time_step * (1.0 + 1e-9)), 1)
    return max(steps for steps in range(1, min(most, shared) + 1) if shared % steps == 0)

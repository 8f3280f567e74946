"""Partitions of time, as the configuration and the stages check them; imports nothing, as the former is read often."""

from itertools import pairwise


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

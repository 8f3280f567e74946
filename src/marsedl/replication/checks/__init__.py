"""Whether builds agree with each other and with the committed reference, and the scaffold of a new paper."""

"""The printed claims of the paper, a module for each of its sections."""

"""Entry guidance: where the target lies, which bank range control and lateral control command."""

"""Reproducible replications of papers on Mars entry, descent and landing under uncertainty."""

"""Reproducible replications of papers on Mars entry, descent and landing under uncertainty."""


def __getattr__(name: str) -> str:
    """Look up `__version__` when somebody asks for it: reading metadata takes longer than importing marsedl."""
    if name == "__version__":
        from importlib.metadata import version

        return version("marsedl")
    raise AttributeError(f"module 'marsedl' has no attribute '{name}'")

"""The replicated papers, one package each."""

from functools import cache
from importlib import import_module
from pathlib import Path

from marsedl.replication.errors import InputError, nearest
from marsedl.replication.pipeline.catalogue import TEXTS, Paper

SLUGS = ("powered_descent", "random_field", "desensitized", "funnels", "stochastic_entry")


@cache
def catalogue(slug: str) -> Paper:
    """Return a paper's bill of materials, with its words and what its functions declare; raises InputError."""
    if slug not in SLUGS:
        raise InputError(f"there is no paper '{slug}'; {nearest(slug, SLUGS)}")
    from marsedl.replication.pipeline.declarations import declared  # here, as jobs import this package without it
    from marsedl.replication.pipeline.fingerprints import fingerprints_of
    from marsedl.replication.report.texts import with_texts

    written = with_texts(import_module(f"marsedl.papers.{slug}").PAPER, Path(__file__).parent / slug / TEXTS)
    return declared(written, input_model(slug), fingerprints_of())


def input_model(slug: str) -> type:  # of Inputs, which jobs import this package without
    """Return the class of a paper's typed inputs."""
    return import_module(f"marsedl.papers.{slug}.inputs").Inputs

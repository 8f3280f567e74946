"""The replicated papers, one package each."""

from importlib import import_module
from typing import TYPE_CHECKING

from marsedl.replication.catalogue import Paper

if TYPE_CHECKING:  # jobs import this package too, and need none of pydantic
    from marsedl.replication.inputs import Inputs

SLUGS = ("powered_descent", "random_field", "desensitized", "funnels", "stochastic_entry")


def catalogue(slug: str) -> Paper:
    """Return a paper's bill of materials."""
    return import_module(f"marsedl.papers.{slug}").PAPER


def rounding_noise() -> dict[str, tuple[str, ...]]:
    """Return what rounding decides in each paper, see `Paper.noise`."""
    return {slug: catalogue(slug).noise for slug in SLUGS}


def input_model(slug: str) -> "type[Inputs]":
    """Return the class of a paper's typed inputs."""
    return import_module(f"marsedl.papers.{slug}.inputs").MODEL

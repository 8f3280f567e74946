"""The names of the report's files, which the rules ask for before anything that writes them is imported."""

from collections.abc import Iterable, Mapping

ASSETS = ("site.css", "site.js", "explorer.js", "minisearch.js")
SEARCH_DATA, EXPLORED = "assets/search-data.js", "assets/universes-{}.js"
COMPARISON = "comparison"  # the page of all papers together, and its folder
ARENA = "arena"  # the page of guidance laws beside each other, and its folder
APART = (COMPARISON, ARENA)  # pages of no paper
OTHER_PAGES = ("index", *APART, "about")
PROVENANCE, ZIP = "provenance.csv", "report.zip"
HEADLINE = "headline"  # the picture of what is printed and what is found on one axis, of a paper's headline claims


def site_files(figures: Mapping[str, Iterable[str]]) -> list[str]:
    """Return the files of a report, from the names of figures by slug, or by the name of a page of no paper."""
    return [
        *(f"{page}.html" for page in dict.fromkeys([*OTHER_PAGES, *figures])),
        *(f"{slug}_evidence.html" for slug in figures if slug not in APART),
        *(f"assets/{name}" for name in ASSETS),
        *(EXPLORED.format(slug) for slug in figures if slug not in APART),
        *(SEARCH_DATA, PROVENANCE),
        *(f"pictures/{slug}/{name}.png" for slug, names in figures.items() for name in names),
        ZIP,
    ]


def universe_pictures(headlines: Iterable[str]) -> dict[str, str]:
    """Return captions of the pictures of a paper's universes by name: of all claims, then two for each headline."""
    captions = {"heat_map": "Every choice and every claim", "closing_in": "What is not ruled out"}
    for number, said in enumerate(headlines, 1):
        captions[f"headline_{number}_values"] = f"{said}: its values over all universes"
        captions[f"headline_{number}_choices"] = f"{said}: what each choice moves by itself"
    return {f"universes/{name}": caption for name, caption in captions.items()}

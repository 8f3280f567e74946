"""The few words that the report and the README define before they use them, from `words.yaml`."""

from pathlib import Path

from marsedl.replication.errors import InputError
from marsedl.replication.strict_yaml import read_yaml

FILE = Path(__file__).with_name("words.yaml")


def words(path: Path = FILE) -> dict[str, str]:
    """Return the words with their definitions, in the order in which they are shown.

    Args:
        path: the file with a sentence for each word; backticks mark code.

    Raises:
        InputError: the file is malformed.

    """
    document = read_yaml(path)
    if not isinstance(document, dict) or not all(isinstance(text, str) for text in document.values()):
        raise InputError(f"{path}: expected words, each with its definition in one sentence")
    return {word: " ".join(text.split()) for word, text in document.items()}

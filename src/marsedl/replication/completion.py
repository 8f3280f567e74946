"""A shell script that completes commands, options, and the names of what papers have."""

import argparse
import shlex
from collections.abc import Iterable, Mapping

_SCRIPT = """\
_{prog}() {{
  local word=${{COMP_WORDS[COMP_CWORD]}} before=() typed
  for typed in "${{COMP_WORDS[@]:1:COMP_CWORD-1}}"; do [[ $typed == -* ]] || before+=("$typed"); done
  local words=
  case "${{before[*]}}" in
{cases}
  esac
  case "${{before[0]}}" in
{options}
  esac
  COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o bashdefault -o default -F _{prog} {prog}
"""


def script(parser: argparse.ArgumentParser, shell: str, items: Mapping[str, Mapping[str, Iterable[str]]]) -> str:
    """Return a script that a shell evaluates; files are completed where it knows no words.

    Args:
        parser: of all commands.
        shell: "bash" or "zsh".
        items: by paper and command, the words that may follow the name of the paper.

    """
    commands = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction)).choices
    words = {"": [*commands, *parser._option_string_actions]}
    for command, of_command in commands.items():
        positional = next((action for action in of_command._actions if not action.option_strings), None)
        if positional and positional.choices:
            words[command] = positional.choices
        elif positional and positional.dest == "paper":
            words[command] = items
            words |= {f"{command} {paper}": follow[command] for paper, follow in items.items() if command in follow}
    options = {command: of_command._option_string_actions for command, of_command in commands.items()}
    text = _SCRIPT.format(prog=parser.prog, cases=_branches(words, "words="), options=_branches(options, "words+=' '"))
    return text if shell == "bash" else f"autoload -Uz bashcompinit && bashcompinit\n{text}"


def _branches(words: Mapping[str, Iterable[str]], assignment: str) -> str:
    """The branches of a `case` of the shell, one for each key, that assign its words."""
    return "\n".join(
        f"    {shlex.quote(key)}) {assignment}{shlex.quote(' '.join(completions))} ;;"
        for key, completions in words.items()
    )

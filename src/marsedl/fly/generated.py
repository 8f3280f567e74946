"""Functions of a flight that are written as text, such as those of names that only a declaration knows."""

__all__ = ["generated"]


def generated(asked, lines, returns, like=None, **names):
    """The function of these lines, annotated with what it returns.

    Args:
        asked: names of its arguments, all checked; any may come several times. lines: of its body. returns: annotation.
        like: function that messages name in its place. names: what its lines read.
    """
    body = "".join(f"    {line}\n" for line in lines)
    exec(f"def made({', '.join(dict.fromkeys(asked))}):\n{body}", names)
    made = names["made"]
    made.__annotations__["return"], made.__module__ = returns, __name__
    if like:
        code = like.__code__
        place = {"co_filename": code.co_filename, "co_firstlineno": code.co_firstlineno}
        made.__name__, made.__code__ = like.__name__, made.__code__.replace(co_name=code.co_name, **place)
    return made

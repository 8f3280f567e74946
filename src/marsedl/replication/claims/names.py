"""Names of verdicts and kinds of claims, in one place that takes no time to import."""

REFUTED_VERDICTS = ("differs", "fails")  # which need a reason
COUNTED_VERDICTS = ("reproduced", "close", "differs", "holds", "fails", "undetermined")
AGREEING_VERDICTS = ("reproduced", "close", "holds")  # with which a claim agrees with the paper
BY_CONSTRUCTION = "by_construction"  # what cannot fail
# Inputs, literature and what cannot fail: shown, never counted.
LISTED_VERDICTS = ("as_stated", "not_as_stated", "quoted", BY_CONSTRUCTION)
UNDECIDED = "undetermined"  # the kind of what the paper's own problem does not fix
NUMBERS, STATEMENTS = "numbers", "statements"  # the two kinds of results, which are counted apart
VERDICTS_OF = {
    NUMBERS: ("reproduced", "close", "differs", "undetermined"),
    STATEMENTS: ("holds", "fails", "undetermined"),
}
MEASURED = ("deterministic", "monte_carlo")  # kinds that compare numbers with numbers
STATED = ("input", "context")  # kinds that are listed and never counted

"""Edits that matter change the code digest of a stage; edits that do not matter leave it alone."""

import shutil
import textwrap

import pytest

from marsedl.replication.errors import InputError, MarsedlError
from marsedl.replication.pipeline import fingerprints
from marsedl.replication.pipeline.fingerprints import Fingerprints

ENTRY = "marsedl.papers.stage:compute"

TREE = {
    "marsedl/__init__.py": '"""The package."""\n',
    "marsedl/models/__init__.py": "",
    "marsedl/models/gravity.py": '''
        """Gravity."""
        import numpy as np

        MU = 4.28e13  # m^3/s^2
        J2, J3 = 1.9e-3, 3.1e-5
        UNUSED = 1
        TABLE = {}

        def kernel(f):
            """Mark a kernel."""
            return f

        def strength():
            return 1

        def default_height():
            return 0.0

        @kernel
        def gravity(radius, height=default_height()):
            """Acceleration."""
            return MU / radius**2 * strength() + np.exp(height)

        def oblateness(radius):
            return J2 / radius

        def unused(radius):
            return UNUSED * radius
    ''',
    "marsedl/models/vehicle.py": '''
        from marsedl.models.gravity import TABLE

        class Body:
            """A body."""
            drag = 1.0

        class Vehicle(Body):
            """A vehicle."""

            def lift(self):
                """Lift."""
                return 2.0
    ''',
    "marsedl/models/deep.py": "def only_inside():\n    return 1\n",
    "marsedl/models/dynamic.py": "def a():\n    return 1\n\ndef b():\n    return 2\n",
    "marsedl/methods/__init__.py": "from marsedl.methods.steering import steer as steer_it\n",
    "marsedl/methods/steering.py": """
        def steer(x):
            return helper(x)

        def helper(x):
            return x

        def other(x):
            return x
    """,
    "marsedl/papers/__init__.py": "",
    "marsedl/papers/stage.py": '''
        """The stage."""
        import numpy as np
        from marsedl import methods
        from marsedl.models import gravity as gr
        from marsedl.models.gravity import oblateness as flattening
        from marsedl.models.vehicle import Vehicle

        CONSTANT = 3.0

        def compute(inputs):
            """Compute it."""
            from marsedl.models.deep import only_inside
            return gr.gravity(CONSTANT) + flattening(1.0) + methods.steer_it(2) + Vehicle().lift() + only_inside()

        def draw(inputs):
            return inputs
    ''',
}


@pytest.fixture
def tree(tmp_path):
    for name, text in TREE.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(textwrap.dedent(text))
    return tmp_path


def of(tree, scripts="none"):
    return Fingerprints(tree / "none" / "fingerprints.json", tree, tree / scripts)


def fingerprint(entry, tree):
    return of(tree).code(entry)


def edit(tree, name, old, new):
    path = tree / name
    text = path.read_text()
    assert old in text, f"the test edits nothing: {old!r}"
    path.write_text(text.replace(old, new, 1))


def changes(tree, name, old, new, entry=ENTRY):
    before = fingerprint(entry, tree)
    edit(tree, name, old, new)
    return fingerprint(entry, tree) != before


GRAVITY, STAGE, STEERING = "marsedl/models/gravity.py", "marsedl/papers/stage.py", "marsedl/methods/steering.py"

SAME = {
    "comment": (GRAVITY, "# m^3/s^2", "# cubic metres"),
    "module docstring": (GRAVITY, '"""Gravity."""', '"""Weight."""'),
    "function docstring": (GRAVITY, '"""Acceleration."""', '"""Something\n    longer."""'),
    "class docstring": ("marsedl/models/vehicle.py", '"""A vehicle."""', '"""Another."""'),
    "format": (GRAVITY, "MU / radius**2", "(MU   /\n        radius ** 2)"),
    "unreached function in a shared module": (GRAVITY, "UNUSED * radius", "UNUSED + radius"),
    "unreached constant": (GRAVITY, "UNUSED = 1", "UNUSED = 2"),
    "unreached neighbour": (STEERING, "def other(x):\n    return x", "def other(x):\n    return -x"),
    "new unreached function": (GRAVITY, "def strength", "def new():\n    return 0\n\ndef strength"),
    "new import of a library": (GRAVITY, "import numpy as np", "import numpy as np\nimport scipy"),
    "order of functions": (
        STEERING,
        "def steer(x):\n    return helper(x)\n\ndef helper(x):\n    return x\n",
        "def helper(x):\n    return x\n\ndef steer(x):\n    return helper(x)\n",
    ),
    "unimported module": ("marsedl/models/dynamic.py", "return 1", "return 3"),
}

DIFFERENT = {
    "the function itself": (STAGE, "flattening(1.0)", "flattening(1.5)"),
    "int to float": (STAGE, "steer_it(2)", "steer_it(2.0)"),
    "via module alias": (GRAVITY, "MU / radius**2", "MU / radius**3"),
    "via a called function": (GRAVITY, "return 1\n", "return 2\n"),
    "via constant": (GRAVITY, "MU = 4.28e13", "MU = 4.29e13"),
    "via tuple constant": (GRAVITY, "J2, J3 = 1.9e-3", "J2, J3 = 2.0e-3"),
    "via from-import": (GRAVITY, "J2 / radius", "J2 * radius"),
    "via re-export": (STEERING, "return helper(x)", "return helper(2 * x)"),
    "via re-export, transitively": (STEERING, "def helper(x):\n    return x", "def helper(x):\n    return -x"),
    "the re-export itself": ("marsedl/methods/__init__.py", "import steer as", "import other as"),
    "via decorator": (GRAVITY, "return f", "return abs(f)"),
    "decorator removed": (GRAVITY, "@kernel\n", ""),
    "via default argument": (GRAVITY, "return 0.0", "return 1.0"),
    "via class method": ("marsedl/models/vehicle.py", "return 2.0", "return 2.5"),
    "via base class": ("marsedl/models/vehicle.py", "drag = 1.0", "drag = 1.1"),
    "via import inside a function": ("marsedl/models/deep.py", "return 1", "return 2"),
    "other library": (GRAVITY, "import numpy as np", "import jax.numpy as np"),
    "statement at import": (GRAVITY, "TABLE = {}", "TABLE = {}\nnp.seterr(all='raise')"),
    "item set at import": (GRAVITY, "UNUSED = 1", "UNUSED = 1\nTABLE['x'] = strength"),
    "if at import": (GRAVITY, "UNUSED = 1", "if np:\n    UNUSED = 1"),
    "statement at import of an ancestor": (
        "marsedl/models/__init__.py",
        "",
        "import numpy\nnumpy.seterr(all='raise')\n",
    ),
    "second assignment": (STAGE, "CONSTANT = 3.0", "CONSTANT = 3.0\nCONSTANT = 4.0"),
    "shadowed by a later definition": (GRAVITY, "def oblateness", "def strength():\n    return 5\n\ndef oblateness"),
}


@pytest.mark.parametrize("case", SAME)
def test_an_edit_without_meaning_for_the_stage_keeps_the_digest(tree, case):
    assert not changes(tree, *SAME[case])


@pytest.mark.parametrize("case", DIFFERENT)
def test_an_edit_that_the_stage_can_reach_changes_the_digest(tree, case):
    assert changes(tree, *DIFFERENT[case])


@pytest.mark.parametrize(
    ("stage", "old", "counts"),
    [
        ("from marsedl.models import dynamic\ndef compute(n):\n    return getattr(dynamic, n)()", "return 2", True),
        ("from marsedl import models\ndef compute(n):\n    return getattr(models.dynamic, n)()", "return 2", True),
        (
            "from marsedl.models import dynamic\nCHOICE = dynamic\ndef compute(n):\n    return CHOICE.b()",
            "return 2",
            True,
        ),
        ("import marsedl.models.dynamic\ndef compute():\n    return marsedl.models.dynamic.a()", "return 1", True),
        ("import marsedl.models.dynamic\ndef compute():\n    return marsedl.models.dynamic.a()", "return 2", False),
        (
            "try:\n    from marsedl.models.dynamic import a\nexcept ImportError:\n    a = 1\ncompute = a",
            "return 1",
            True,
        ),
    ],
)
def test_what_counts_of_another_module(tree, stage, old, counts):
    """All of it, as an object; or what is named."""
    (tree / STAGE).write_text(stage)
    assert changes(tree, "marsedl/models/dynamic.py", old, "return 3") == counts


def test_circular_imports_are_followed(tree):
    (tree / "marsedl/one.py").write_text("from marsedl import two\ndef f():\n    return two.g()\n")
    (tree / "marsedl/two.py").write_text("from marsedl import one\ndef g():\n    return h, one.f\nh = 1\n")
    assert changes(tree, "marsedl/two.py", "h = 1", "h = 2", entry="marsedl.one:f")


@pytest.mark.parametrize(
    ("use", "hides"),
    [
        ("def compute(one):\n    return one()", True),
        ("def compute(*, one):\n    return [lambda: one.part]", True),
        ("def compute(one=one):\n    return one()", False),
        ("def compute(one: one):\n    return 2", False),
        ("def compute(one):\n    return other(one)\ndef other(x):\n    return one(x)", False),
    ],
)
def test_a_parameter_hides_the_symbol_of_its_name(tree, use, hides):
    (tree / STAGE).write_text(f"def one():\n    return 1\n{use}")
    assert changes(tree, STAGE, "return 1", "return 3") != hides


def test_digest_does_not_depend_on_the_folder(tree, tmp_path_factory):
    (tree / "shim.py").write_text("from marsedl.papers.stage import compute\ncompute(1)\n")
    other = shutil.copytree(tree, tmp_path_factory.mktemp("elsewhere") / "tree")
    assert fingerprint(ENTRY, tree) == fingerprint(ENTRY, other)
    assert of(tree).kernels() == of(other).kernels()
    assert of(tree, ".").code("shim.py") == of(other, ".").code("shim.py")


@pytest.mark.parametrize(
    ("code", "used"),
    [
        ("import scipy\ndef compute():\n    return 1\n", []),
        ("import scipy\ndef compute():\n    return scipy.sqrt(1)\n", ["scipy"]),
        ("import scipy.linalg as la\ndef compute():\n    return la.inv(1)\n", ["scipy"]),
        (
            "from scipy.linalg import inv\ndef compute():\n    return helper()\ndef helper():\n    return inv\n",
            ["scipy"],
        ),
        (
            "def compute():\n    from casadi import SX\n    import scipy.linalg\n    return SX, scipy.linalg\n",
            ["casadi", "scipy"],
        ),
        ("from numba import njit\n@njit\ndef compute():\n    return 1\n", ["numba"]),
        ("import math, os.path\ndef compute():\n    return math.pi, os.path.sep\n", []),
        ("from marsedl.models import gravity\ndef compute():\n    return gravity.kernel\n", []),
        ("from marsedl.models.library import solve\ndef compute():\n    return solve()\n", ["scipy"]),
        ("from marsedl.models.library import other\ndef compute():\n    return other()\n", []),
    ],
)
def test_libraries_are_those_whose_names_are_used(tree, code, used):
    (tree / STAGE).write_text(code)
    library = "from scipy import optimize\ndef solve():\n    return optimize.root\ndef other():\n    return 1\n"
    (tree / "marsedl/models/library.py").write_text(library)
    assert of(tree).libraries(ENTRY) == used
    (tree / "shim.py").write_text("from marsedl.papers.stage import compute\ncompute()\n")
    assert of(tree, ".").libraries("shim.py") == used


def test_script_digest_covers_the_script_and_what_it_reaches(tree):
    script = tree / "workflow/shim.py"
    script.parent.mkdir()
    script.write_text("# a comment\nfrom marsedl.models import gravity\nsnakemake.log(gravity.strength())\n")
    before = of(tree, "workflow").code("shim.py")
    edit(tree, "workflow/shim.py", "# a comment", "# another")
    edit(tree, GRAVITY, "UNUSED * radius", "UNUSED + radius")
    assert of(tree, "workflow").code("shim.py") == before
    edit(tree, GRAVITY, "return 1", "return 2")
    reached_edit = of(tree, "workflow").code("shim.py")
    edit(tree, "workflow/shim.py", "snakemake.log", "snakemake.print")
    assert len({before, reached_edit, of(tree, "workflow").code("shim.py")}) == 3


KERNEL = """
from numba import njit
from marsedl.models.gravity import strength

def compiled(function):
    return njit(cache=True)(function)

@njit(cache=True)
def fly():
    return strength()

@compiled
def add():
    return 1

@njit
def inner():
    return 2
"""


def test_kernels_are_what_numba_caches_and_their_digest_is_of_what_they_reach(tree):
    before = of(tree).kernels()
    (tree / "marsedl" / "kernel.py").write_text(KERNEL, encoding="utf-8")
    assert of(tree).compiled() == ["marsedl.kernel:fly", "marsedl.kernel:add"]
    with_kernels = of(tree).kernels()
    assert with_kernels != before
    edit(tree, "marsedl/kernel.py", "return 2", "return 3")
    assert of(tree).kernels() == with_kernels, "no cached kernel reaches it"
    edit(tree, "marsedl/kernel.py", "return 1", "return 4")
    assert of(tree).kernels() != with_kernels


@pytest.mark.parametrize("digest", [lambda tree: fingerprint(ENTRY, tree), lambda tree: of(tree).kernels()])
def test_a_syntax_error_names_file_and_line(tree, digest):
    edit(tree, GRAVITY, "def strength():", "def strength(:")
    with pytest.raises(MarsedlError, match=r"gravity\.py, line \d+"):
        digest(tree)


@pytest.mark.parametrize(
    ("entry", "named"),
    [
        ("marsedl.papers.stage:comptue", "there is no such function .* did you mean 'compute'"),
        ("marsedl.papers.nothing:compute", "there is no such function"),
        ("marsedl.papers.stage", "there is no such function"),
        ("nothing.py", "there is no such function"),
    ],
)
def test_a_wrong_entry_is_refused_by_name(tree, entry, named):
    with pytest.raises(InputError, match=named):
        fingerprint(entry, tree)


def test_a_changed_file_is_noticed_and_a_damaged_memory_is_forgotten(tree):
    memory = tree / "memory" / "fingerprints.json"

    def remembered():
        return Fingerprints(memory, tree, tree / "none")

    first = remembered()
    before = first.code(ENTRY)
    first.save()
    edit(tree, GRAVITY, "return 1", "return 2")
    after_edit = remembered()
    assert after_edit.code(ENTRY) == fingerprint(ENTRY, tree) != before
    first.kernels()
    first.save()  # computed before the change: not to be kept under either key
    after_edit.save()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fingerprints, "_parsed", None)  # nothing is parsed again
        assert remembered().code(ENTRY) == after_edit.code(ENTRY)
    assert before not in memory.read_text(encoding="utf-8")
    for damaged in ("", "{", "[]", '{"key": 1}', "3"):
        memory.write_text(damaged, encoding="utf-8")
        assert remembered().code(ENTRY) == fingerprint(ENTRY, tree)

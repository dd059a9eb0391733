"""The package: public names, loaded on first use, and threads that read headers of NumPy's files at once."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import firstfix

STUB = Path(firstfix.__file__).with_suffix(".pyi")
NAMES = sorted(set(firstfix.__all__) - {"__version__"})


def names_of_the_stub() -> set[str]:
    """Names that type checkers see, and the module of each."""
    names = set()
    for node in ast.parse(STUB.read_text()).body:
        if isinstance(node, ast.ImportFrom):
            names |= {str(alias.asname) for alias in node.names}
        elif isinstance(node, ast.AnnAssign):
            names.add(ast.unparse(node.target))
    return names


def test_dir_shows_the_public_names_alone():
    import firstfix.engine.localizer

    assert dir(firstfix) == sorted(firstfix.__all__)
    assert len(set(firstfix.__all__)) == len(firstfix.__all__)


def test_type_checkers_see_the_same_names():
    assert names_of_the_stub() == set(firstfix.__all__)


@pytest.mark.parametrize("name", NAMES)
def test_a_public_name_is_importable_and_documented(name: str):
    value = getattr(firstfix, name)
    text = inspect.getdoc(value)
    assert text
    assert not text.startswith(f"{name}("), "a dataclass's signature is no docstring"
    assert not inspect.isclass(value) or value.__name__ == name
    assert name in (firstfix.__doc__ or "").replace(",", " ").split()


def test_other_names_are_refused():
    with pytest.raises(AttributeError, match="no attribute 'Robot'"):
        _ = firstfix.Robot


def run(program: str) -> str:
    return subprocess.run([sys.executable, "-c", program], capture_output=True, check=True, text=True).stdout


def test_nothing_is_loaded_before_its_use():
    loaded = "sorted(name for name in sys.modules if name.startswith(('firstfix.', 'numpy')))"
    assert run(f"import sys, firstfix; print({loaded})").strip() == "[]"


def test_a_missing_package_says_what_to_install():
    """The base installation has no pydantic, obstore or scipy."""
    program = (
        "import sys; sys.modules['scipy'] = sys.modules['pydantic'] = None\n"
        "import firstfix\n"
        "try: firstfix.MapIndex\n"
        "except ImportError as error: print(error)"
    )
    assert "pip install '.[service]' in the checkout" in run(program)


# Collections of garbage let another thread in while a tree is made.
PROGRAM = """
import ast, gc, os, sys, threading, time
import firstfix.catalog

HEADER = "[" + "{'descr': '<f8'}, " * 40 + "]"
failed = []

def read():
    for _ in range(400):
        try:
            ast.literal_eval(HEADER)
        except SystemError as error:
            failed.append(error)

gc.callbacks.append(lambda phase, info: time.sleep(1e-4))
gc.set_threshold(20)
threads = [threading.Thread(target=read) for _ in range(4)]
for thread in threads:
    thread.start()
for _ in range(5):
    child = os.fork()
    if not child:
        ast.literal_eval(HEADER)
        os._exit(0)
    if os.waitpid(child, 0)[1]:
        failed.append(child)
for thread in threads:
    thread.join()
gc.set_threshold(700)
sys.exit(len(failed) > 0)
"""


@pytest.mark.timeout(240)
def test_threads_that_read_at_once_do_not_fail_and_a_fork_does_not_hang():
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr

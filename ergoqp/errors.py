"""What can be wrong with user input: one sentence each, saying what, where, got and allowed."""

import json
import shlex
import sys
from pathlib import Path


class ErgoqpError(Exception):
    """Root of the package's own errors; its text is one sentence for the user.

    On the command line the exit status is 2.

    Example:
        >>> import ergoqp
        >>> try:
        ...     ergoqp.load_problem("no such problem")
        ... except ergoqp.errors.ErgoqpError as error:
        ...     print(type(error).__name__)
        ProblemError
    """


class InputError(ErgoqpError, ValueError):
    """A value of the user's is not usable: wrong shape, unit, name or range.

    Example:
        >>> from ergoqp.errors import InputError
        >>> from ergoqp.human import Body
        >>> try:
        ...     Body(stature=175.0)
        ... except InputError as error:
        ...     print(error)
        stature: got 175.0 m, allowed 1.2 to 2.3 m
    """


class OutOfReachError(InputError):
    """The person of a problem can be at rest at none of the places that were tried.

    Example:
        >>> from ergoqp.errors import InputError, OutOfReachError
        >>> issubclass(OutOfReachError, InputError)
        True
    """


class WorkersError(ErgoqpError):
    """The processes that were to solve the starts are gone.

    What they finished is in the ledger, where there is one.

    Example:
        >>> from ergoqp.errors import ErgoqpError, WorkersError
        >>> issubclass(WorkersError, ErgoqpError)
        True
    """


class RecordingError(ErgoqpError):
    """A motion-capture file cannot be read as what it claims to be.

    Example:
        >>> import ergoqp
        >>> try:
        ...     ergoqp.load_recording("nowhere.bvh")
        ... except ergoqp.errors.RecordingError as error:
        ...     print(str(error).split(":")[0])
        nowhere.bvh
    """


class UnknownNamesError(RecordingError):
    """The joints or markers of a recording are of no known naming.

    Args:
        words: the sentence.
        names: of the joints or markers, as the recording has them.

    Example:
        >>> import ergoqp
        >>> import numpy as np
        >>> names = [f"point_{number}" for number in range(9)]
        >>> try:
        ...     ergoqp.fit_postures(names, np.zeros((3, 9, 3)), 30.0)
        ... except ergoqp.errors.UnknownNamesError as error:
        ...     print(error.names[0])
        point_0
    """

    def __init__(self, words: str, names: tuple[str, ...]) -> None:
        """Keep the names for whoever writes a mapping file."""
        super().__init__(words)
        self.names = names


class ProblemError(ErgoqpError, ValueError):
    """A problem is not well posed: unknown or contradictory terms; lists every mistake found.

    Example:
        >>> import ergoqp
        >>> try:
        ...     ergoqp.load_problem("no such problem")
        ... except ergoqp.errors.ProblemError as error:
        ...     print(str(error).split(",")[0])
        problem: got 'no such problem'
    """


class MissingExtraError(ErgoqpError, ImportError):
    """An optional dependency is needed and absent.

    Args:
        what: what needs it, for example ``"the report page"``.
        extra: name of the extra that installs it.
        module: the module that failed to import.

    Example:
        >>> from ergoqp.errors import MissingExtraError
        >>> print(str(MissingExtraError("the report page", "report", "viser")).split(":")[0])
        the report page needs the package 'viser'
    """

    def __init__(self, what: str, extra: str, module: str) -> None:
        """Compose the one sentence that names the extra."""
        super().__init__(
            f"{what} needs the package {module!r}: install it with `{install_command(extra)}`"
        )


class ModelError(ErgoqpError):
    """A learned model cannot be fitted from this data, or its file is not one.

    Such a file is cut, changed or of another kind.

    Example:
        >>> import ergoqp
        >>> try:
        ...     ergoqp.load_cost("nowhere.npz")
        ... except ergoqp.errors.ModelError as error:
        ...     print(str(error).split(":")[0])
        nowhere.npz
    """


def in_words(error: BaseException) -> str:
    """Return what code of the user's raised, in a few words: its kind and what it says."""
    return f"{type(error).__name__} ({' '.join(str(error).split())[:100]})"


def install_command(extra: str) -> str:
    """Return the command that adds an extra to this installation.

    Args:
        extra: its name in pyproject.toml.

    Returns:
        The command for the interpreter that runs, and for the checkout that the package was
        installed from, where it is still there, else for an index.
    """
    # Only who lacks something waits for these.
    from importlib.metadata import PackageNotFoundError, distribution
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    try:
        origin = json.loads(distribution("ergoqp").read_text("direct_url.json") or "{}")
    except PackageNotFoundError:
        origin = {}
    source, option = "ergoqp", ""
    if "dir_info" in origin:
        folder = url2pathname(urlsplit(origin["url"]).path)
        # What others built and packed again, as conda does, names a folder of theirs.
        if Path(folder).is_dir():
            source, option = folder, "-e " if origin["dir_info"].get("editable") else ""
    # Of several interpreters it is the running one that lacks it.
    python = shlex.quote(sys.executable or "python")
    return f"{python} -m pip install {option}{shlex.quote(f'{source}[{extra}]')}"

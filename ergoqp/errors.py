"""Errors in user input. Each message names the value, what was given and what is allowed."""

import json
import shlex
import sys
from pathlib import Path


class ErgoqpError(Exception):
    """Base class of the package's own errors. The text is one sentence for the user.

    On the command line the exit status is 2, and 3 for a `NothingScoredError`.

    Example:
        >>> import ergoqp
        >>> try:
        ...     ergoqp.load_problem("no such problem")
        ... except ergoqp.errors.ErgoqpError as error:
        ...     print(type(error).__name__)
        ProblemError
    """


class InputError(ErgoqpError, ValueError):
    """A value from the user cannot be used: wrong shape, unit, name or range.

    Example:
        >>> from ergoqp.errors import InputError
        >>> from ergoqp.human import Body
        >>> try:
        ...     Body(stature=175.0)
        ... except InputError as error:
        ...     print(error)
        stature: got 175.0 m, allowed 1.2 to 2.3 m (centimetres?)
    """


class OutOfReachError(InputError):
    """The person of a problem has no rest at any of the places that were tried.

    Example:
        >>> from ergoqp.errors import InputError, OutOfReachError
        >>> issubclass(OutOfReachError, InputError)
        True
    """


class WorkersError(ErgoqpError):
    """The processes or the cluster that should have done the work are gone.

    Example:
        >>> from ergoqp.errors import ErgoqpError, WorkersError
        >>> issubclass(WorkersError, ErgoqpError)
        True
    """


class RecordingError(ErgoqpError):
    """A motion-capture file cannot be read, or does not have the format that it claims.

    Example:
        >>> import ergoqp
        >>> try:
        ...     ergoqp.load_recording("nowhere.bvh")
        ... except ergoqp.errors.RecordingError as error:
        ...     print(str(error).split(":")[0])
        nowhere.bvh
    """


class NothingScoredError(RecordingError):
    """No frame of a recording shows a trunk, so that none has a score.

    On the command line the exit status is 3, because all files are written nevertheless.

    Example:
        >>> from ergoqp.errors import NothingScoredError, RecordingError
        >>> issubclass(NothingScoredError, RecordingError)
        True
    """


class UnknownNamesError(RecordingError):
    """Joints or markers of a recording follow no known naming scheme, and are needed.

    Args:
        words: the message.
        names: names of the joints or markers in the recording that are not read.

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
        """Keep the names, so that a mapping file can be written from them."""
        super().__init__(words)
        self.names = names


class ProblemError(ErgoqpError, ValueError):
    """A problem is not well posed: it has unknown or contradictory terms.

    Example:
        >>> import ergoqp
        >>> try:
        ...     ergoqp.load_problem("no such problem")
        ... except ergoqp.errors.ProblemError as error:
        ...     print(str(error).split(",")[0])
        problem: got 'no such problem'
    """


class MissingExtraError(ErgoqpError, ImportError):
    """An optional dependency is needed but not installed.

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
    """A learned model cannot be fitted to the data, or a file does not hold a valid model.

    Such a file is truncated, changed or of another kind.

    Example:
        >>> import ergoqp
        >>> try:
        ...     ergoqp.load_cost("nowhere.npz")
        ... except ergoqp.errors.ModelError as error:
        ...     print(str(error).split(":")[0])
        nowhere.npz
    """


def last_line(error: BaseException) -> str:
    """Return the last line of an error, which says most of those of CasADi; else its type."""
    return (str(error).strip().splitlines() or [type(error).__name__])[-1]


def in_words(error: BaseException) -> str:
    """Return an exception that user code raised in a few words: its type and its message."""
    return f"{type(error).__name__} ({' '.join(str(error).split())[:100]})"


def install_command(extra: str) -> str:
    """Return the command that installs an extra into this installation.

    Args:
        extra: its name in pyproject.toml.

    Returns:
        The command, for the running interpreter. It installs from the checkout that the
        package was installed from if that still exists, else from a package index.
    """
    # Imported here because only this rare function needs them.
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
        # In a package that was built elsewhere, for example by conda, this folder does not
        # exist.
        if Path(folder).is_dir():
            source, option = folder, "-e " if origin["dir_info"].get("editable") else ""
    # The extra is missing in the running interpreter, which may be one of several.
    python = shlex.quote(sys.executable or "python")
    return f"{python} -m pip install {option}{shlex.quote(f'{source}[{extra}]')}"

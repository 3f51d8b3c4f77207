"""Everything that tensegraph raises on purpose.

TensegraphError
├── InputError           a file, a value or a setting is not what it must be
├── RecordingError       a recording that had begun can not go on
└── IndeterminateError   the measurements and priors do not determine the shape
"""


class TensegraphError(Exception):
    """Base of all errors raised on purpose; its text is one line that says what to do."""


class InputError(TensegraphError):
    """A file, a value or a setting is not what it must be: says where, what was expected, and what was found."""


class RecordingError(TensegraphError):
    """A recording that had begun can not go on: names the trial and the system's reason."""


class IndeterminateError(TensegraphError):
    """The measurements and priors of a frame do not determine its shape: names the nodes and what is missing."""

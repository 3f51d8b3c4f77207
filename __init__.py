"""tensegraph: the shape of a tensegrity, with uncertainty, from its strain-sensing tendons.

The public names are loaded when they are first used, so that `import tensegraph` and `tensegraph --help` are quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .commands.simulate import simulate as simulate
    from .io.trial_directory import Trial as Trial
    from .io.trial_directory import open_trial as open_trial
    from .models.settings import Settings as Settings
    from .models.structure.reconstruction import Reconstruction as Reconstruction
    from .models.structure.shape import Ellipsoids as Ellipsoids
    from .models.structure.shape import Shape as Shape
    from .models.structure.shape import Status as Status
    from .models.structure.structure import Structure as Structure
    from .models.structure.structure import six_strut as six_strut
    from .models.structure.structure import three_strut as three_strut
    from .models.values.errors import IndeterminateError as IndeterminateError
    from .models.values.errors import InputError as InputError
    from .models.values.errors import TensegraphError as TensegraphError
    from .models.values.readings import BoardReading as BoardReading
    from .models.values.readings import Flag as Flag
    from .models.values.readings import Mode as Mode
    from .models.values.readings import ResistanceReading as ResistanceReading
    from .models.values.readings import TendonLengths as TendonLengths
    from .pipeline import reconstruct as reconstruct
    from .pipeline import save as save
    from .pipeline import stream as stream

_MODULE_OF = {
    "simulate": ".commands.simulate",
    "Trial": ".io.trial_directory",
    "open_trial": ".io.trial_directory",
    "Settings": ".models.settings",
    "Reconstruction": ".models.structure.reconstruction",
    "Ellipsoids": ".models.structure.shape",
    "Shape": ".models.structure.shape",
    "Status": ".models.structure.shape",
    "Structure": ".models.structure.structure",
    "six_strut": ".models.structure.structure",
    "three_strut": ".models.structure.structure",
    "IndeterminateError": ".models.values.errors",
    "InputError": ".models.values.errors",
    "TensegraphError": ".models.values.errors",
    "BoardReading": ".models.values.readings",
    "Flag": ".models.values.readings",
    "Mode": ".models.values.readings",
    "ResistanceReading": ".models.values.readings",
    "TendonLengths": ".models.values.readings",
    "reconstruct": ".pipeline",
    "save": ".pipeline",
    "stream": ".pipeline",
    "pipeline": ".pipeline",
}
"""Where each public name is defined; the imports above say the same to type checkers."""


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    module = import_module(_MODULE_OF[name], __name__)
    found = module if name == "pipeline" else getattr(module, name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULE_OF})

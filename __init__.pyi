from . import pipeline as pipeline
from . import plot as plot
from .commands.simulate import simulate as simulate
from .io.exports.formats import export as export
from .io.stored_result import load as load
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

__version__: str

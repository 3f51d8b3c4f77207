"""tensegraph: the shape of a tensegrity, with uncertainty, from its strain-sensing tendons."""

from .io.trial import Trial as Trial
from .io.trial import open_trial as open_trial
from .models.errors import IndeterminateError as IndeterminateError
from .models.errors import InputError as InputError
from .models.errors import TensegraphError as TensegraphError
from .models.readings import BoardReading as BoardReading
from .models.readings import Flag as Flag
from .models.readings import Mode as Mode
from .models.readings import ResistanceReading as ResistanceReading
from .models.readings import TendonLengths as TendonLengths
from .models.reconstruction import Reconstruction as Reconstruction
from .models.settings import Settings as Settings
from .models.shape import Ellipsoids as Ellipsoids
from .models.shape import Shape as Shape
from .models.shape import Status as Status
from .models.structure import Structure as Structure
from .models.structure import six_strut as six_strut
from .models.structure import three_strut as three_strut
from .pipeline import reconstruct as reconstruct
from .pipeline import save as save
from .pipeline import stream as stream
from .simulation import simulate as simulate

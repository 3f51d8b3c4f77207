"""tensegraph: the shape of a tensegrity, with uncertainty, from its strain-sensing tendons.

The public names stand in `__init__.pyi`. Each is loaded when it is first used, so that `import tensegraph` is quick.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

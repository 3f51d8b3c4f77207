"""tensegraph: the shape of a tensegrity, with uncertainty, from its strain-sensing tendons.

The public names stand in `__init__.pyi`. Each is loaded when it is first used, so that `import tensegraph` is quick.
"""

from typing import Any

import lazy_loader

_public_name, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name != "__version__":
        value = _public_name(name)
        from .models.values.field_help import describe_fields

        describe_fields(value)
        return value
    from importlib.metadata import version  # as long as the rest of the import

    return version("tensegraph")

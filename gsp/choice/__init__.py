"""What to run for a scene: the cheapest model that meets its tolerance."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={"choice": ["select"]})

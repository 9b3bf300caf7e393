from . import io as io
from . import linalg as linalg
from . import mapping as mapping
from . import scan as scan
from . import sim as sim
from . import solve as solve

def isa() -> str: ...

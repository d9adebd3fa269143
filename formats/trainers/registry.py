"""The layouts by the names of `vlnpe convert --to` and `vlnpe collect --also`."""

from .internvla_n1 import INTERNVLA_N1
from .navdp import NAVDP
from .navila import NAVILA
from .sharegpt import SHAREGPT
from .streamvln import STREAMVLN
from .subset import Layout
from .uni_navid import UNI_NAVID

LAYOUTS: dict[str, Layout] = {
    layout.name: layout for layout in (NAVILA, STREAMVLN, INTERNVLA_N1, NAVDP, UNI_NAVID, SHAREGPT)
}

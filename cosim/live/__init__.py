"""The live link of section 3.6: crane and controller joined by UDP datagrams at 1 kHz.

from cosim.live import Layout, Link, Master
"""

from cosim.live.layout import Layout, load_layout
from cosim.live.link import Link
from cosim.live.master import Master

__all__ = ["Layout", "Link", "Master", "load_layout"]

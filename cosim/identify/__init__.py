"""Identification, chapter 4 of the source: dead zone, frequency response, transfer functions, observer, scaling."""

from cosim.calls import make_callable

make_callable(__name__)

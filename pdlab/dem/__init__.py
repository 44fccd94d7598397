"""The basement: discrete elements in reduced units, arrays in, arrays out.

No SQL, no files, no page. Length is the largest diameter, mass density that of the material, and
gravity is one, so time is in units of sqrt(d/g).
"""

VERSION = 3
"""Raised by hand whenever a bed's bytes change; a run of another version is another run."""

"""The description of a case: tables, units and scales, sweeps, checks, identity.

- fields: how a key is declared, and how it is found from its path
- problems: errors of a configuration, in words
- rotor, bearings, settings: tables of the machine, the operating point, the numerics and the linear stages
- curve_settings, survey_settings, torus_settings, transient_settings, refine_settings, calibrate_settings:
  tables of the other stages
- models: the case: all tables, and the checks of one against another
- stage_checks, plausible: what a stage requires of its tables; numbers in the wrong unit
- scales, ring_statics: dimensionless variables and parameters; deformation of the active ring
- measuring, units: what a key measures; numbers in rpm, Hz, s and um, and back
- sweeps, sampling, reading, locating, rewriting: from TOML text to cases, with line numbers, and back
- imports: rotors of other programs and drawings as configurations
- identity, reference: the hash of a case; the reference of all keys
- arrays: types of arrays, for all layers above
"""

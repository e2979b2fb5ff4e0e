"""Rotors of other programs and drawings, as configurations with the foil bearings left to fill in.

- parts: a rotor with what was told about it; checks of its parts against the tables of a case
- ross: rotors saved by ROSS
- sections: CSV tables of shaft sections
- draft: the text of the configuration, and the choice of its master nodes
"""

"""The effects of the catalogue, by the part of the inverter that they change."""

"""Records of events and models: the measured voltage played back into the averaged model of a
diagram, its current compared.
"""

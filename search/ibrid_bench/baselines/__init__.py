"""Other ways to a model from the same sweep: vector fitting, sparse regression, a textbook diagram,
beside the search.
"""

"""Two diagrams matched up to naming and drawing: rewritten, paired, compared.

From outside of `structure`: `compare`.
"""

"""How numbers, pages and pictures look: few digits, one style sheet, one way from axes to SVG.

From outside of `report`: `figure`, `numbers`, `style`. Imports nothing else of `report`.
"""

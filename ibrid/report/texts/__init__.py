"""What commands print.

From outside of `report`: `experiments_text`, `gap_text`, `generic_text`, `playback_text`,
`prediction_text`, `stability_text`, `text`.
"""

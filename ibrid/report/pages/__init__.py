"""Self-contained HTML pages, and how objects show themselves in notebooks.

From outside of `report`: `gap_page`, `generic_page`, `notebook`, `page`, `playback_page`,
`stability_page`, `template`.
"""

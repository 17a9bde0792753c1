"""Self-contained HTML pages, and how objects show themselves in notebooks.

From outside: `page` (write_report), `gap_page`, `template`.
"""

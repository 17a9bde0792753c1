"""The sections of the page about a run; `search.page` puts them together."""

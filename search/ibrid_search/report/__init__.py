"""The sections of the page about a run; `ibrid_search.page` puts them together."""

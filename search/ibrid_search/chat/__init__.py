"""A language model at the other end of a wire: requests, answers in the forms that servers know,
and what it all costs.

From outside of `ibrid_search`: `chat`, `chat_request`, `chat_server`, `spending`.
"""

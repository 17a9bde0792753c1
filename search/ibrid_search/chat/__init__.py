"""A language model at the other end of a wire: requests, answers in the forms that servers know, and what it all costs.

From outside: `chat`, `chat_server`, `spending`.
"""

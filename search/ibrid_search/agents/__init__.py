"""The evaluator as tools: for an agent of ours, and over MCP for others.

From outside of `ibrid_search`: `mcp_server`.
"""

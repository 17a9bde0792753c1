"""What the search brings to the command line, found by the entry point `search` of
`ibrid.commands`.

`commands.toml` of `ibrid.commands` says which function runs a command. From outside of
`ibrid_search`: none.
"""

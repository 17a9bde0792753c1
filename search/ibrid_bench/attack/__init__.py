"""What a hostile user, file or machine would try, and what is left standing."""

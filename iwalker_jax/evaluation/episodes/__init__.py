"""Episodes by sight: metrics, tables, films and the report."""

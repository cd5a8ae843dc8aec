"""Research notebooks: each is a script in jupytext's percent format, and beside it the notebook with its outputs."""

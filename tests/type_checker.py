"""What checks the library's annotations when tests call it: beartype, for which a whole number is also a float."""

from beartype import BeartypeConf, beartype

checked = beartype(conf=BeartypeConf(is_pep484_tower=True))

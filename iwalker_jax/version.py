"""The version of the package, which data made by it carry."""

__version__ = "0.1.0"

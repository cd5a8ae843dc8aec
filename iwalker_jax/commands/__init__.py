"""The commands: options, progress, tables and pictures around the library, started by `launch`."""

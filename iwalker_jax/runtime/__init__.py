"""The process and its machine: settings, devices, groups of processes and files; imports no JAX by itself."""

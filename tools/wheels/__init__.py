"""Wheels with the native library: which systems it runs on (`needs`), how it gets into a wheel (`pack`), and whether what is
installed from that works (`check`)."""

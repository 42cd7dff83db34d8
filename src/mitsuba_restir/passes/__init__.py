"""The passes of a frame, one module each: plain data in, plain data out."""

"""Makes `small`, the builder of tiny cases, importable from every test below this folder."""

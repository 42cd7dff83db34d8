"""The viewer: a scene in a browser, rendered live; :func:`.notebook.view` shows it in a notebook.

All that Mitsuba does happens in one thread, :mod:`.worker`; what it is to render, and what it has
rendered, is in :mod:`.session`; pages and connections only read and change that.
"""

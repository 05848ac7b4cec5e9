"""The live page of a session that is being recorded: images, curves, rates, gaps and alarms.

``session_snapshot`` says how the session is, ``session_routes`` answers the page's requests,
``page`` serves them. It needs the ``[browse]`` extra.
"""

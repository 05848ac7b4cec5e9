"""The page on which a person cuts a recorded session into episodes.

``cutting_document`` is the list of episodes and its file, ``preview_images`` the pictures of the
cameras over time, ``cutting_routes`` answers the page's requests. It needs the ``[browse]`` extra.
"""

"""Small classifiers of grasps and how well they do: the proof that a dataset teaches.

``train`` fits them and compares them with what needs no learning; ``learning_curve`` says how that
grows with the data. Needs the extra ``[train]``: torch, safetensors, scikit-learn, matplotlib.
"""

"""Categories in; weights, their confidence and a model card out. No estimator needs this room.

| module | does |
| --- | --- |
| `training_shapes`, `scenes`, `samples`, `dataset` | random shapes and pictures of them, rendered once |
| `backgrounds`, `augmentation`, `prefetch` | what is drawn anew for every batch |
| `beginning` | what networks begin with: random weights, or the shipped layers |
| `losses`, `schedule`, `training`, `processes`, `log` | the optimisation, resumable, on one process or more |
| `pictures`, `wrong_inputs`, `verdict_fit` | right and wrong inputs, and the verdicts fitted to them |
| `confidence_fit`, `model_card` | how far the networks can be trusted, and what their card says of it |
"""

"""The forearm as the state: elbow and wrist of the right arm, six numbers.

The package contains its data, its true cost and its descents.
"""

from ergoqp.studies.forearm.data import forearm_data as forearm_data
from ergoqp.studies.forearm.data import nearest_sample_cost as nearest_sample_cost
from ergoqp.studies.forearm.truth import true_cost as true_cost
from ergoqp.studies.forearm.truth import true_posture as true_posture

"""Hashes of ROS 2's types (RIHS01, REP-2016), by which its tools tell whether two sides mean the same type.

They are equal in every distribution since Iron, because these messages have not changed.
"""

from __future__ import annotations

from . import imu, point_cloud2, pose_message, tf_message

TRIGGER = "std_srvs/srv/Trigger"
DISCOVERY = "rmw_dds_common/msg/ParticipantEntitiesInfo"
POSE_ARRAY, DIAGNOSTICS = "geometry_msgs/msg/PoseArray", "diagnostic_msgs/msg/DiagnosticArray"
TYPE_HASHES = {
    point_cloud2.TYPE: "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
    pose_message.TYPE: "RIHS01_26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e",
    imu.TYPE: "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
    tf_message.TYPE: "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    POSE_ARRAY: "RIHS01_af0cc36d190e104d546d168d6b39df04fa4b4ccecf59cb4c9ed328d3d5004aa0",
    DIAGNOSTICS: "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    f"{TRIGGER}_Request": "RIHS01_d010825374ce8918e72bfd826c82603e60f45419e932ea976f807b74a863a199",
    f"{TRIGGER}_Response": "RIHS01_2d946c21e2fc3f1e9ca6986a8191d85fcc70097a8bb7771a053564bc47009cdf",
    TRIGGER: "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
    DISCOVERY: "RIHS01_91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e",
}

//! Cameras and projectors: intrinsics with distortion, poses, epipolar geometry, from boards and structured light.

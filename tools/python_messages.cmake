# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

# Included by tactile_msgs when ./tactile builds it: leave out the C++ generators, which take half
# of the build and serve no package of this workspace. rclpy needs those for C, introspection
# included: rmw_fastrtps_cpp describes a type to DDS by it. `colcon build` without ./tactile runs
# all generators.
find_package(rosidl_default_generators REQUIRED)
list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "^rosidl_[a-z_]*_cpp:")

# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

# Included by tactile_msgs when ./tactile builds it: run only the generators that rclpy needs on
# rmw_fastrtps_cpp. The others (C++ and introspection) take more than half of the build and serve
# no package of this workspace. `colcon build` without ./tactile runs all of them.
find_package(rosidl_default_generators REQUIRED)
list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE
  REGEX "^rosidl_[a-z_]*(_cpp|introspection_c):")

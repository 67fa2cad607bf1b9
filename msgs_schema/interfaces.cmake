# What CMake does for each package of interfaces. Include it after project(), with DEPENDENCIES set.
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
foreach(_package IN LISTS DEPENDENCIES)
  find_package(${_package} REQUIRED)
endforeach()

# Wheels of ROS 2 export targets that name include directories of the machine that built them.
get_property(_imported DIRECTORY PROPERTY IMPORTED_TARGETS)
foreach(_target IN LISTS _imported)
  if(_target MATCHES "__rosidl_generator_py$")
    get_target_property(_directories ${_target} INTERFACE_INCLUDE_DIRECTORIES)
    set(_present)
    foreach(_directory IN LISTS _directories)
      if(_directory MATCHES "^\\$<" OR EXISTS "${_directory}")
        list(APPEND _present "${_directory}")
      endif()
    endforeach()
    set_target_properties(${_target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${_present}")
  endif()
endforeach()

# rclpy needs no C++, and a wheel has no other users.
if(SKBUILD)
  list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "_cpp:")
endif()

file(GLOB _interfaces CONFIGURE_DEPENDS RELATIVE "${CMAKE_CURRENT_SOURCE_DIR}"
  "msg/*.msg" "srv/*.srv" "action/*.action")
rosidl_generate_interfaces(${PROJECT_NAME} ${_interfaces} DEPENDENCIES ${DEPENDENCIES})

ament_export_dependencies(rosidl_default_runtime)
ament_package()

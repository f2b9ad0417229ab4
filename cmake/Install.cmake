# SPDX-License-Identifier: Apache-2.0
# What `cmake --install` installs: the programs with profiles, scenes, the udev rule, manual pages,
# shell completion, documents and examples; and libraries for other projects, as a CMake package
# and for pkg-config: docs/libraries.md.
include(CMakePackageConfigHelpers)

# The programs and what they read.
install(TARGETS forcegrid_cli RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
if(TARGET forcegrid_tools_program)
  install(TARGETS forcegrid_tools_program RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
  # Made by forcegrid-tools: cli/CMakeLists.txt.
  install(DIRECTORY ${FORCEGRID_REFERENCE_DIR}/man/ DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
  install(FILES ${FORCEGRID_REFERENCE_DIR}/forcegrid.bash RENAME forcegrid
          DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)
  install(FILES ${FORCEGRID_REFERENCE_DIR}/forcegrid.zsh RENAME _forcegrid
          DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/vendor-completions)
endif()
if(TARGET forcegrid_view)
  install(TARGETS forcegrid_view RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
  install(DIRECTORY view/page/ DESTINATION ${CMAKE_INSTALL_DATADIR}/forcegrid/view)
  install(FILES view/forcegrid-view.1 DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
endif()
install(DIRECTORY profiles/ DESTINATION ${CMAKE_INSTALL_DATADIR}/forcegrid/profiles
        FILES_MATCHING PATTERN "*.toml")
install(DIRECTORY simulator/scenes/ DESTINATION ${CMAKE_INSTALL_DATADIR}/forcegrid/scenes
        FILES_MATCHING PATTERN "*.toml")
install(DIRECTORY ${FORCEGRID_MADE_MESHES_DIR}/ DESTINATION ${CMAKE_INSTALL_DATADIR}/forcegrid/scenes
        OPTIONAL FILES_MATCHING PATTERN "*.msh")
# udev reads /usr/lib/udev, whatever the folder of libraries is.
install(FILES udev/10-forcegrid.rules DESTINATION lib/udev/rules.d)

# Documents and examples, which refer to each other by relative links.
install(FILES README.md CHANGELOG.md LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(DIRECTORY docs DESTINATION ${CMAKE_INSTALL_DOCDIR}
        FILES_MATCHING PATTERN "*.md" PATTERN "*.svg" PATTERN site EXCLUDE)
install(DIRECTORY examples DESTINATION ${CMAKE_INSTALL_DOCDIR}
        FILES_MATCHING PATTERN "*.md" PATTERN "*.c" PATTERN "*.cpp" PATTERN "*.h" PATTERN "*.py"
        PATTERN "*.sh" PATTERN __pycache__ EXCLUDE)

# For other projects: the rooms that a program can be built from, with the C interface of devices.
set(package_folder ${CMAKE_INSTALL_LIBDIR}/cmake/forcegrid)
set(rooms rt log text profiles contact link forcegrid driver device_emulator servo_loop device_session)
set(rooms_of_libraries ${rooms})
list(REMOVE_ITEM rooms_of_libraries forcegrid)
list(TRANSFORM rooms_of_libraries PREPEND forcegrid_)
install(TARGETS forcegrid ${rooms_of_libraries} forcegrid_unit_profiles EXPORT forcegrid-targets
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
foreach(room rt log text profiles contact driver device_session)
  set_target_properties(forcegrid_${room} PROPERTIES EXPORT_NAME ${room})
endforeach()
set_target_properties(forcegrid_device_emulator PROPERTIES EXPORT_NAME emulator)
set_target_properties(forcegrid_servo_loop PROPERTIES EXPORT_NAME servo)
set_target_properties(forcegrid_unit_profiles PROPERTIES EXPORT_NAME unit_profiles)
if(TARGET forcegrid_c)
  install(TARGETS forcegrid_c forcegrid_c_static EXPORT forcegrid-targets
          LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
  install(DIRECTORY bindings/c/include/forcegrid DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
endif()
set(pkg_config_names forcegrid forcegrid-link forcegrid-device)
if(FORCEGRID_SHARED_LIBRARIES)
  install(TARGETS ${FORCEGRID_SHARED_LIBRARIES} EXPORT forcegrid-targets
          LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR})
  list(APPEND pkg_config_names forcegrid-methods-shared forcegrid-link-shared forcegrid-servo-shared)
endif()
install(DIRECTORY ${rooms} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/forcegrid
        FILES_MATCHING PATTERN "*.h")
include(ForwardingHeaders)
install(DIRECTORY ${FORCEGRID_FORWARDING_DIR}/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/forcegrid)
install(EXPORT forcegrid-targets NAMESPACE forcegrid:: DESTINATION ${package_folder})
configure_package_config_file(cmake/forcegrid-config.cmake.in forcegrid-config.cmake
                              INSTALL_DESTINATION ${package_folder})
# Before 1.0 a new minor version may change interfaces.
write_basic_package_version_file(forcegrid-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/forcegrid-config.cmake
              ${PROJECT_BINARY_DIR}/forcegrid-config-version.cmake
        DESTINATION ${package_folder})

# The prefix is known only when the copy is made (cmake --install --prefix).
foreach(name IN LISTS pkg_config_names)
  install(CODE "
    set(PROJECT_VERSION ${PROJECT_VERSION})
    set(LIBDIR ${CMAKE_INSTALL_LIBDIR})
    set(INCLUDEDIR ${CMAKE_INSTALL_INCLUDEDIR})
    configure_file(${PROJECT_SOURCE_DIR}/cmake/${name}.pc.in ${PROJECT_BINARY_DIR}/${name}.pc @ONLY)")
  install(FILES ${PROJECT_BINARY_DIR}/${name}.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
endforeach()

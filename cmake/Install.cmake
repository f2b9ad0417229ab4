# SPDX-License-Identifier: Apache-2.0
# What `cmake --install` installs: the programs with profiles, scenes, the udev rule, manual pages,
# shell completion, documents and examples; and for other projects the methods
# (forcegrid::forcegrid) and the link's client library (forcegrid::link), as a CMake package and for
# pkg-config.
include(GNUInstallDirs)
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
install(DIRECTORY profiles/ DESTINATION ${CMAKE_INSTALL_DATADIR}/forcegrid/profiles
        FILES_MATCHING PATTERN "*.toml")
install(DIRECTORY simulator/scenes/ DESTINATION ${CMAKE_INSTALL_DATADIR}/forcegrid/scenes)
# udev reads /usr/lib/udev, whatever the folder of libraries is.
install(FILES udev/10-forcegrid.rules DESTINATION lib/udev/rules.d)

# Documents and examples, which refer to each other by relative links.
install(FILES README.md CHANGELOG.md LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(DIRECTORY docs DESTINATION ${CMAKE_INSTALL_DOCDIR}
        FILES_MATCHING PATTERN "*.md" PATTERN "*.svg" PATTERN site EXCLUDE)
install(DIRECTORY examples DESTINATION ${CMAKE_INSTALL_DOCDIR}
        FILES_MATCHING PATTERN "*.md" PATTERN "*.c" PATTERN "*.cpp" PATTERN "*.h" PATTERN "*.py"
        PATTERN "*.sh" PATTERN __pycache__ EXCLUDE)

# For other projects.
set(package_folder ${CMAKE_INSTALL_LIBDIR}/cmake/forcegrid)
install(TARGETS forcegrid forcegrid_link EXPORT forcegrid-targets
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(DIRECTORY forcegrid link DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/forcegrid
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
foreach(name forcegrid forcegrid-link)
  install(CODE "
    set(PROJECT_VERSION ${PROJECT_VERSION})
    set(LIBDIR ${CMAKE_INSTALL_LIBDIR})
    set(INCLUDEDIR ${CMAKE_INSTALL_INCLUDEDIR})
    configure_file(${PROJECT_SOURCE_DIR}/cmake/${name}.pc.in ${PROJECT_BINARY_DIR}/${name}.pc @ONLY)")
  install(FILES ${PROJECT_BINARY_DIR}/${name}.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
endforeach()

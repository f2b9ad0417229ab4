# SPDX-License-Identifier: Apache-2.0
# The C++ libraries for other programs as shared ones, linked from the objects of the static ones. They
# export what the headers declare between `#pragma GCC visibility push(default)` and `pop`, under one
# version; everything else in them is hidden: docs/libraries.md. An interface holds for one minor
# version, so that the SONAME carries it.
find_package(PkgConfig REQUIRED)
find_package(ZLIB REQUIRED)
find_package(spdlog 1.10 REQUIRED)
find_package(nlohmann_json 3.11 REQUIRED)
pkg_check_modules(libsodium REQUIRED IMPORTED_TARGET libsodium)
pkg_check_modules(hidapi_hidraw REQUIRED IMPORTED_TARGET hidapi-hidraw)
pkg_check_modules(libusb REQUIRED IMPORTED_TARGET libusb-1.0)

set(abi ${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
set(exports ${PROJECT_BINARY_DIR}/exports.map)
configure_file(cmake/exports.map.in ${exports} @ONLY)

# forcegrid_shared_library(NAME ROOMS static libraries... [PUBLIC ...] [PRIVATE ...]):
# libforcegrid-NAME.so as forcegrid::NAME_shared, of all objects of ROOMS. A room is in one such library
# alone, so that its data exist once.
function(forcegrid_shared_library name)
  cmake_parse_arguments(arg "" "" "ROOMS;PUBLIC;PRIVATE" ${ARGN})
  set(target forcegrid_${name}_shared)
  list(TRANSFORM arg_ROOMS REPLACE ".+" "$<TARGET_OBJECTS:\\0>" OUTPUT_VARIABLE objects)
  add_library(${target} SHARED ${objects})
  add_library(forcegrid::${name}_shared ALIAS ${target})
  set_target_properties(${target} PROPERTIES
    OUTPUT_NAME forcegrid-${name} EXPORT_NAME ${name}_shared LINKER_LANGUAGE CXX
    VERSION ${PROJECT_VERSION} SOVERSION ${abi} LINK_DEPENDS ${exports}
    LIBRARY_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/lib)
  target_compile_features(${target} INTERFACE cxx_std_20)
  target_include_directories(${target} INTERFACE
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}> $<INSTALL_INTERFACE:include/forcegrid>)
  # Names are resolved when the library is loaded, its own within it: no servo cycle waits for that.
  target_link_options(${target} PRIVATE -Wl,--version-script=${exports} -Wl,--as-needed -Wl,-z,now
    -Wl,-Bsymbolic-functions $<$<STREQUAL:${FORCEGRID_SANITIZE},>:-Wl,-z,defs>)
  target_link_libraries(${target} PUBLIC ${arg_PUBLIC}
    PRIVATE ${arg_PRIVATE} $<BUILD_INTERFACE:forcegrid_sanitizers>)
endfunction()

forcegrid_shared_library(methods ROOMS forcegrid PUBLIC Eigen3::Eigen PRIVATE hwy)
forcegrid_shared_library(link ROOMS forcegrid_link PRIVATE ZLIB::ZLIB PkgConfig::libsodium)
forcegrid_shared_library(servo
  ROOMS forcegrid_rt forcegrid_log forcegrid_text forcegrid_profiles forcegrid_contact forcegrid_driver
        forcegrid_unit_profiles forcegrid_device_emulator forcegrid_servo_loop forcegrid_device_session
  PUBLIC forcegrid_methods_shared forcegrid_link_shared Eigen3::Eigen Threads::Threads
         nlohmann_json::nlohmann_json
  PRIVATE spdlog::spdlog PkgConfig::hidapi_hidraw PkgConfig::libusb ${CMAKE_DL_LIBS})
# Wherever it is installed, it finds the others beside it.
set_target_properties(forcegrid_servo_shared PROPERTIES INSTALL_RPATH "$ORIGIN")
# By the names of the static ones.
foreach(name driver emulator device_session)
  add_library(forcegrid_${name}_shared INTERFACE)
  add_library(forcegrid::${name}_shared ALIAS forcegrid_${name}_shared)
  set_target_properties(forcegrid_${name}_shared PROPERTIES EXPORT_NAME ${name}_shared)
  target_link_libraries(forcegrid_${name}_shared INTERFACE forcegrid_servo_shared)
endforeach()
set(FORCEGRID_SHARED_LIBRARIES forcegrid_methods_shared forcegrid_link_shared forcegrid_servo_shared
    forcegrid_driver_shared forcegrid_emulator_shared forcegrid_device_session_shared)

# A program that is linked with both kinds would have two of each: CMake refuses it.
foreach(target IN LISTS FORCEGRID_SHARED_LIBRARIES)
  set_target_properties(${target} PROPERTIES INTERFACE_FORCEGRID_LIBRARIES shared
                                             COMPATIBLE_INTERFACE_STRING FORCEGRID_LIBRARIES)
endforeach()

# SPDX-License-Identifier: Apache-2.0
# How every library and test of the project is declared: one place for the language level, the
# warnings and the sanitizers, all private to the target (no global flags).

add_library(forcegrid_warnings INTERFACE)
target_compile_options(forcegrid_warnings INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion -Wnon-virtual-dtor
  -Woverloaded-virtual -Wcast-align -Wno-psabi
  $<$<BOOL:${FORCEGRID_WARNINGS_AS_ERRORS}>:-Werror>)

add_library(forcegrid_sanitizers INTERFACE)
if(FORCEGRID_SANITIZE STREQUAL "address")
  set(flags -fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer)
elseif(FORCEGRID_SANITIZE STREQUAL "thread")
  set(flags -fsanitize=thread)
elseif(FORCEGRID_SANITIZE STREQUAL "fuzzer")
  set(flags -fsanitize=fuzzer-no-link,address,undefined -fno-sanitize-recover=all
            -fno-omit-frame-pointer)
elseif(NOT FORCEGRID_SANITIZE STREQUAL "")
  message(FATAL_ERROR "FORCEGRID_SANITIZE is '${FORCEGRID_SANITIZE}'; use address, thread or, with "
                      "clang, fuzzer")
endif()
if(flags AND FORCEGRID_SANITIZE_NOT)
  list(APPEND flags -fno-sanitize=${FORCEGRID_SANITIZE_NOT})
endif()
if(flags)
  target_compile_options(forcegrid_sanitizers INTERFACE ${flags})
  target_link_options(forcegrid_sanitizers INTERFACE ${flags})
  # Function multiversioning resolves before a sanitizer's runtime is up, and the allocation
  # test replaces malloc: both stay out of sanitized builds.
  target_compile_definitions(forcegrid_sanitizers INTERFACE FORCEGRID_SANITIZED=1)
endif()

# Eight sources of a library in one: they share the headers and the templates that they make of them,
# which takes a third of the time. A library's sources have no name twice in their anonymous namespaces.
# The presets that look for mistakes compile each source alone.
option(FORCEGRID_UNITY_BUILD "Compile the sources of a library eight at a time" ON)

option(FORCEGRID_PRECOMPILED_HEADERS "Precompile the headers that most sources include" ON)
if(NOT CMAKE_CXX_COMPILER_ID STREQUAL "GNU" OR CMAKE_SYSTEM_PROCESSOR STREQUAL "cortex-m7")
  set(FORCEGRID_PRECOMPILED_HEADERS OFF)  # ccache would need other flags; firmware has few sources
endif()

# Reading the same headers is a quarter of a library's time, so that they are compiled once for all
# libraries of the same options. Sources with options of their own need SKIP_PRECOMPILE_HEADERS.
# `make lint` compiles without them: each source includes what it uses.
set(FORCEGRID_COMMON_HEADERS
  <Eigen/Cholesky> <Eigen/Core> <Eigen/Geometry> <Eigen/LU> <algorithm> <array> <atomic> <charconv>
  <chrono> <cmath> <deque> <filesystem> <fstream> <functional> <map> <memory> <mutex> <optional>
  <random> <span> <sstream> <string> <thread> <vector>)

# forcegrid_library(NAME [COLD] [OWN_HEADERS] sources...): a static library whose headers are included
# as "folder/header.h". COLD: what it does is never in a hurry, so little time goes into optimising
# it. OWN_HEADERS: it has options that other libraries don't have.
function(forcegrid_library name)
  cmake_parse_arguments(arg "COLD;OWN_HEADERS" "" "" ${ARGN})
  add_library(${name} STATIC ${arg_UNPARSED_ARGUMENTS})
  target_compile_features(${name} PUBLIC cxx_std_20)
  target_include_directories(${name} PUBLIC
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}> $<INSTALL_INTERFACE:include/forcegrid>)
  target_link_libraries(${name} PRIVATE $<BUILD_INTERFACE:forcegrid_warnings>
                                PUBLIC $<BUILD_INTERFACE:forcegrid_sanitizers>)
  # Position-independent, so that shared libraries can be made of them, and hidden there, except what
  # headers show. All names are called and inlined as in a program.
  target_compile_options(${name} PRIVATE -fno-semantic-interposition)
  if(arg_COLD AND CMAKE_BUILD_TYPE STREQUAL "Release")
    target_compile_options(${name} PRIVATE -O1)
  endif()
  set_target_properties(${name} PROPERTIES UNITY_BUILD ${FORCEGRID_UNITY_BUILD}
                                           UNITY_BUILD_BATCH_SIZE 8
                                           POSITION_INDEPENDENT_CODE ON
                                           CXX_VISIBILITY_PRESET hidden
                                           VISIBILITY_INLINES_HIDDEN ON
                                           INTERFACE_FORCEGRID_LIBRARIES static
                                           COMPATIBLE_INTERFACE_STRING FORCEGRID_LIBRARIES)
  if(FORCEGRID_PRECOMPILED_HEADERS)
    if(arg_OWN_HEADERS)
      target_precompile_headers(${name} PRIVATE ${FORCEGRID_COMMON_HEADERS})
    elseif(arg_COLD)
      target_precompile_headers(${name} REUSE_FROM forcegrid_headers_cold)
    else()
      target_precompile_headers(${name} REUSE_FROM forcegrid_headers)
    endif()
    target_compile_options(${name} PRIVATE -fpch-preprocess)  # for ccache
  endif()
endfunction()

if(FORCEGRID_PRECOMPILED_HEADERS)
  file(WRITE ${PROJECT_BINARY_DIR}/headers.cpp "")
  forcegrid_library(forcegrid_headers OWN_HEADERS ${PROJECT_BINARY_DIR}/headers.cpp)
  forcegrid_library(forcegrid_headers_cold COLD OWN_HEADERS ${PROJECT_BINARY_DIR}/headers.cpp)
  target_precompile_headers(forcegrid_headers_cold PRIVATE <nlohmann/json.hpp>)
  foreach(target forcegrid_headers forcegrid_headers_cold)
    target_link_libraries(${target} PRIVATE Eigen3::Eigen)
  endforeach()
endif()

# Tests are compiled for a quick build: half of their time goes into the headers of GoogleTest, Eigen
# and the standard library, and a third into optimising code that runs for milliseconds.
function(forcegrid_quick_to_compile name)
  if(CMAKE_BUILD_TYPE STREQUAL "Release")
    target_compile_options(${name} PRIVATE -O1)
  endif()
  if(FORCEGRID_PRECOMPILED_HEADERS)
    target_precompile_headers(${name} REUSE_FROM forcegrid_live_main)
    target_compile_options(${name} PRIVATE -fpch-preprocess)  # for ccache
  endif()
endfunction()

# Half of a unit test's time is its process's and ctest's, so ctest knows whole test suites, as
# PROGRAM.SUITE. Tests that run in real time are single ones, since a failed one may run again.
option(FORCEGRID_TESTS_ONE_BY_ONE "Let ctest know every single unit test by its name" OFF)

# forcegrid_discover_suites(NAME PROPERTY VALUE...): the suites of a built test program are ctest's.
function(forcegrid_discover_suites name)
  set(list ${CMAKE_CURRENT_BINARY_DIR}/${name}_suites.cmake)
  if(NOT EXISTS ${list})
    file(WRITE ${list} "add_test(${name}_NOT_BUILT ${name}_NOT_BUILT)\n")
  endif()
  string(REPLACE ";" "," properties "${ARGN}")
  add_custom_command(TARGET ${name} POST_BUILD
    COMMAND ${CMAKE_COMMAND} -DPROGRAM=$<TARGET_FILE:${name}> -DNAME=${name} -DOUT=${list}
            -DPROPERTIES=${properties} -P ${PROJECT_SOURCE_DIR}/cmake/DiscoverSuites.cmake
    VERBATIM)
  set_property(DIRECTORY APPEND PROPERTY TEST_INCLUDE_FILES ${list})
endfunction()

# All tests labelled unit that are configured.
add_custom_target(forcegrid_unit_tests)

# [s] All tests with a deadline together.
set(FORCEGRID_DEADLINES_COST 250)

# forcegrid_test(NAME LABELS unit|rt|emulator... SOURCES ... LIBS ... [SERIAL] [ALONE] [LIVE] [SINGLE_THREADED] [TIMEOUT s])
# SERIAL: the test keeps deadlines; no other such test runs beside it.
# ALONE: no test at all runs beside it.
# LIVE: what it tests runs in real time, as all does that is labelled emulator: a failure while the
# machine stood still is tried again (tests/support/live_main.cpp).
# SINGLE_THREADED: it starts no thread, so that ThreadSanitizer has nothing to see in it.
function(forcegrid_test name)
  cmake_parse_arguments(arg "SERIAL;ALONE;LIVE;SINGLE_THREADED" "TIMEOUT" "LABELS;SOURCES;LIBS" ${ARGN})
  if(arg_SINGLE_THREADED AND FORCEGRID_SANITIZE STREQUAL "thread")
    return()
  endif()
  if(NOT arg_TIMEOUT)
    set(arg_TIMEOUT 60)
  endif()
  if(FORCEGRID_SANITIZE)
    math(EXPR arg_TIMEOUT "4 * ${arg_TIMEOUT}")  # that much slower
  endif()
  add_executable(${name} ${arg_SOURCES})
  forcegrid_quick_to_compile(${name})
  target_compile_features(${name} PRIVATE cxx_std_20)
  target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR})
  target_compile_definitions(${name} PRIVATE
    FORCEGRID_SOURCE_DIR="${PROJECT_SOURCE_DIR}"
    FORCEGRID_PROGRAM="${CMAKE_RUNTIME_OUTPUT_DIRECTORY}/forcegrid")
  if(arg_LIVE OR "emulator" IN_LIST arg_LABELS)
    set(main forcegrid_live_main)
  else()
    set(main GTest::gtest_main)
  endif()
  target_link_libraries(${name} PRIVATE ${arg_LIBS} forcegrid_warnings forcegrid_sanitizers
                                        GTest::gmock ${main})
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/tests)
  if("unit" IN_LIST arg_LABELS)
    add_dependencies(forcegrid_unit_tests ${name})
  endif()
  # ctest begins with what may take longest, and those of which only one may run at a time are one
  # long test; otherwise that would be alone at the end.
  set(cost ${arg_TIMEOUT})
  if(arg_SERIAL)
    math(EXPR cost "${cost} + ${FORCEGRID_DEADLINES_COST}")
  endif()
  set(properties LABELS "${arg_LABELS}" COST ${cost})
  if(arg_SERIAL)
    list(APPEND properties RESOURCE_LOCK deadlines)
  endif()
  if(arg_ALONE)
    list(APPEND properties RUN_SERIAL ON)
  endif()
  if(arg_LABELS STREQUAL "unit" AND NOT arg_LIVE AND NOT FORCEGRID_TESTS_ONE_BY_ONE)
    math(EXPR arg_TIMEOUT "4 * ${arg_TIMEOUT}")
    forcegrid_discover_suites(${name} ${properties} TIMEOUT ${arg_TIMEOUT})
  else()
    gtest_discover_tests(${name} DISCOVERY_MODE PRE_TEST
                         PROPERTIES ${properties} TIMEOUT ${arg_TIMEOUT})
  endif()
endfunction()

# SPDX-License-Identifier: Apache-2.0
# write_revision.cmake on checkouts made for the purpose.
set(checkout ${FOLDER}/checkout)
file(REMOVE_RECURSE ${FOLDER})
file(MAKE_DIRECTORY ${checkout}/inner)

function(git)
  execute_process(COMMAND git -c user.name=Tester -c user.email=tester@localhost ${ARGN}
                  WORKING_DIRECTORY ${checkout} OUTPUT_VARIABLE said ERROR_VARIABLE error
                  OUTPUT_STRIP_TRAILING_WHITESPACE RESULT_VARIABLE failed)
  if(failed)
    message(FATAL_ERROR "git ${ARGN}: ${error}")
  endif()
  set(said "${said}" PARENT_SCOPE)
endfunction()

# The commit that the sources in `folder` are said to be built from must be `expected`.
function(expect_commit folder expected)
  execute_process(COMMAND ${CMAKE_COMMAND} -DSOURCE=${folder} -DVERSION=1.2.3
                          -DTEMPLATE=${PROJECT}/cli/common/revision.cpp.in -DOUTPUT=${FOLDER}/revision.cpp
                          -P ${PROJECT}/cmake/write_revision.cmake RESULT_VARIABLE failed)
  file(READ ${FOLDER}/revision.cpp text)
  string(REGEX MATCH "kCommit = \"([^\"]*)\"" found "${text}")
  if(failed OR NOT found OR NOT "${CMAKE_MATCH_1}" STREQUAL "${expected}")
    message(SEND_ERROR "of ${folder} expected '${expected}', found '${found}'")
  endif()
  if(NOT text MATCHES "return \"1\\.2\\.3\"")
    message(SEND_ERROR "the version is missing in: ${text}")
  endif()
endfunction()

git(init --quiet .)
file(WRITE ${checkout}/source.cpp "int a;\n")
git(add source.cpp)
git(commit --quiet -m first)
git(rev-parse HEAD)
string(SUBSTRING ${said} 0 12 commit)
expect_commit(${checkout} ${commit})
file(WRITE ${checkout}/source.cpp "int b;\n")
expect_commit(${checkout} ${commit}-changed)
git(commit --quiet -a -m second)
git(rev-parse HEAD)
string(SUBSTRING ${said} 0 12 second)
expect_commit(${checkout} ${second})
if(second STREQUAL commit)
  message(SEND_ERROR "two commits, one name")
endif()
# Unpacked within somebody else's checkout.
expect_commit(${checkout}/inner "")

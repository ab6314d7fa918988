# Finds the build's requirements, and names the package and the install command for a missing one.
# docker/packages.txt maps each to its package: `package(what is found)`.
set(NEED_PACKAGES_FILE ${CMAKE_CURRENT_LIST_DIR}/packages.txt)

# Ends the configure step: `what` could not be found.
function(need_missing what)
  file(STRINGS ${NEED_PACKAGES_FILE} lines REGEX "^[a-z]+:")
  foreach(line IN LISTS lines)
    string(REGEX MATCH "^[a-z]+" section ${line})
    string(REGEX REPLACE "[ \t]+" ";" words ${line})
    foreach(word IN LISTS words)
      string(REGEX MATCH "^([^()]+)\\((.*)\\)$" annotated ${word})
      if(annotated AND CMAKE_MATCH_2 STREQUAL what)
        set(package ${CMAKE_MATCH_1})
        set(cure "docker/install.sh build")
        if(NOT section STREQUAL build)
          string(APPEND cure " ${section}\n(or do without the tests: -DFXAGENT_TESTS=OFF)")
        endif()
        message(FATAL_ERROR "${what} was not found. It is in Debian's package ${package}. "
                            "This installs everything that is needed here:\n${cure}")
      endif()
    endforeach()
  endforeach()
  message(FATAL_ERROR "${what} was not found, and ${NEED_PACKAGES_FILE} has no package for it")
endfunction()

# find_package(), required. A macro, because some packages set variables for the caller.
macro(need_package name)
  find_package(${name} ${ARGN} QUIET)
  if(NOT ${name}_FOUND)
    need_missing(${name})
  endif()
endmacro()

# A header on the compiler's own path.
function(need_header path)
  string(MAKE_C_IDENTIFIER ${path} id)
  find_path(NEED_HEADER_${id} ${path})
  mark_as_advanced(NEED_HEADER_${id})
  if(NOT NEED_HEADER_${id})
    need_missing(${path})
  endif()
endfunction()

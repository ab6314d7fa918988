include(GoogleTest)
need_package(GTest)
need_package(nlohmann_json)
need_header(asio.hpp)

# The tests are compiled quickly, and not optimised. The tested code is compiled as for the plant.
set(quick_options -O0 $<$<CXX_COMPILER_ID:GNU>:-fpch-preprocess>)

# Reading these headers takes most of the time for a test's files, so they are read once for all test programs. The
# product has no precompiled headers: each of its files includes what it uses.
if(NOT TARGET test_headers)
  file(CONFIGURE OUTPUT test_headers.cpp CONTENT "")
  add_library(test_headers OBJECT EXCLUDE_FROM_ALL ${CMAKE_CURRENT_BINARY_DIR}/test_headers.cpp)
  target_link_libraries(test_headers PRIVATE fxagent_options GTest::gtest)
  target_compile_options(test_headers PRIVATE ${quick_options})
  target_precompile_headers(test_headers PRIVATE
    <gtest/gtest.h> <algorithm> <chrono> <functional> <map> <memory> <optional> <string> <variant> <vector>
    <nlohmann/json.hpp>
    <asio/co_spawn.hpp> <asio/io_context.hpp> <asio/post.hpp> <asio/steady_timer.hpp> <asio/use_awaitable.hpp>)
endif()

# Makes a test program quick to compile.
function(precompile target)
  target_precompile_headers(${target} REUSE_FROM test_headers)
  target_compile_options(${target} PRIVATE ${quick_options})
endfunction()

# Registers the tests of a program under a label; further arguments are test properties. With a sanitizer the whole
# program is one entry of ctest: a process of its own for each test took five times as long as the tests.
function(add_unit_tests target labels)
  if(FXAGENT_SANITIZE)
    add_test(NAME ${target} COMMAND ${target})
    set_tests_properties(${target} PROPERTIES LABELS "${labels}" COST 100 TIMEOUT 1200 ${ARGN})
  else()
    gtest_discover_tests(${target} PROPERTIES LABELS "${labels}" TIMEOUT 300 ${ARGN})
  endif()
endfunction()

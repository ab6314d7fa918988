# Tests the script that checks the layers, on small trees: a correct tree passes, and each wrong include fails and is
# reported with its file and line.
#   cmake -DSCRIPT=<layers_test.cmake> -DWORK=<a directory to write in> -P layers_script_test.cmake
cmake_minimum_required(VERSION 3.25)

# Writes the correct tree again.
function(write_tree)
  file(REMOVE_RECURSE "${WORK}")
  file(WRITE "${WORK}/protocol/codec.h" "#include <vector>\n#include <tl/expected.hpp>\n#include \"protocol/value/bytes.h\"\n")
  file(WRITE "${WORK}/agent/agent.cpp" "#include \"agent/field/field.h\"\n#include \"agent/uplink/publisher.h\"\n")
  file(WRITE "${WORK}/agent/log/log.cpp" "#include \"agent/text/text.h\"\n")
  file(WRITE "${WORK}/agent/field/field.cpp" "#include <asio/post.hpp>\n#include \"protocol/codec.h\"\n")
  file(WRITE "${WORK}/agent/store/store.h" "#include <SQLiteCpp/SQLiteCpp.h>\n#include \"agent/commands/journal.h\"\n")
  file(WRITE "${WORK}/agent/uplink/json_payload.cpp" "#include <nlohmann/json.hpp>\n#include \"agent/handover/telemetry.h\"\n")
  file(WRITE "${WORK}/agent/uplink/paho/paho_broker.cpp" "#include <mqtt/async_client.h>\n")
  file(WRITE "${WORK}/tests/sim/main.cpp" "#include <asio/post.hpp>\n#include \"tests/sim/plc.h\"\n")
endfunction()

function(run_layers root)
  execute_process(COMMAND ${CMAKE_COMMAND} "-DROOT=${root}" -P "${SCRIPT}"
                  OUTPUT_VARIABLE out ERROR_VARIABLE err RESULT_VARIABLE status)
  set(status "${status}" PARENT_SCOPE)
  set(text "${out}${err}" PARENT_SCOPE)
endfunction()

write_tree()
run_layers("${WORK}")
if(NOT status EQUAL 0)
  message(FATAL_ERROR "the right tree fails:\n${text}")
endif()

# A file and headers that it may not include, each placed on line 3 of the file.
set(count 0)
foreach(wrong IN ITEMS
    "protocol/plan.cpp <asio.hpp> <asio/steady_timer.hpp> <mqtt/message.h> <nlohmann/json.hpp> <thread> <mutex>"
    "protocol/plan.cpp <sys/socket.h> <termios.h> <unistd.h> \"../agent/config/model.h\""
    "agent/commands/admission.cpp <unistd.h> <sys/socket.h> <cstdio> <time.h> <netinet/in.h> <netdb.h>"
    "agent/commands/admission.cpp <sys/timerfd.h> <spawn.h> <asio/post.hpp>"
    "agent/import/csv.cpp <cstdio> <fcntl.h> <unistd.h> <netinet/in.h> <netdb.h> <sys/timerfd.h> <spawn.h>"
    "agent/config/config.cpp <thread> <sys/socket.h> <netinet/in.h> <netdb.h> <sys/timerfd.h> <spawn.h>"
    "agent/config/config.cpp \"agent/uplink/json_payload.h\" \"uplink/json.h\""
    "agent/remote/trial.cpp <mutex> <netinet/in.h> <netdb.h> <sys/timerfd.h> <spawn.h>"
    "protocol/value/point.h \"protocol/codec.h\""
    "protocol/fx/deep.h \"agent/config/model.h\""
    "agent/field/bus.cpp <mqtt/message.h> <nlohmann/json_fwd.hpp>"
    "agent/field/bus.h \"agent/uplink/json_payload.h\" \"agent/store/store.h\""
    "agent/store/store.cpp <asio/post.hpp> \"agent/field/field.h\" <mqtt/message.h> \"agent/commands/parse/parse.h\""
    "agent/store/store.cpp \"agent/uplink/json_payload.h\""
    "agent/store/store.h \"agent/commands/journal_text.h\""
    "agent/uplink/broker.h <MQTTAsync.h>"
    "agent/handover/telemetry.cpp \"agent/field/field.h\""
    "agent/log/log.cpp \"agent/config/model.h\" \"agent/handover/outbox.h\""
    "agent/text/text.h \"agent/steady_time.h\""
    "agent/commands/admission.h \"agent/store/store.h\" <mutex>"
    "agent/config/model.h \"agent/commands/parse/parse.h\""
    "agent/uplink/session/session.h \"agent/uplink/commands/command_intake.h\""
    "agent/uplink/commands/command_intake.h \"agent/uplink/samples/sample_spool.h\""
    "agent/uplink/samples/sample_spool.h \"agent/uplink/status/status_source.h\""
    "agent/uplink/samples/sample_spool.h \"agent/uplink/retained/retained_state.h\""
    "agent/uplink/retained/retained_state.h \"agent/uplink/samples/sample_spool.h\""
    "agent/uplink/publisher.cpp <sqlite3.h> \"agent/cli/audit/audit_report.h\""
    "agent/cli/audit/audit.cpp <SQLiteCpp/SQLiteCpp.h>"
    "agent/cli/main.cpp <mqtt/message.h>"
    "agent/handover/outbox.h \"tests/support/fake.h\""
    "tests/agent/uplink/a_test.cpp <mqtt/message.h>"
    "tests/sim/plc.cpp \"protocol/value/bytes.h\" \"agent/config/model.h\"")
  string(REPLACE " " ";" headers "${wrong}")
  list(POP_FRONT headers file)
  foreach(header IN LISTS headers)
    write_tree()
    file(WRITE "${WORK}/${file}" "// A file with one include too many.\n#include <string>\n  #  include ${header}\n")
    run_layers("${WORK}")
    string(REGEX REPLACE "[<>\"]" "" name "${header}")
    string(FIND "${text}" "${file}:3: includes ${name}:" place)
    if(status EQUAL 0 OR place EQUAL -1)
      message(FATAL_ERROR "${file} may include ${header}, or is not named:\n${text}")
    endif()
    math(EXPR count "${count} + 1")
  endforeach()
endforeach()

# Lines with other errors, also on line 3.
foreach(wrong IN ITEMS
    "protocol/plan.cpp|#include H"
    "agent/commands/admission.cpp|  # include HEADER"
    "tests/sim/plc.cpp|#include H"
    "protocol/plan.cpp|auto t = std::chrono::steady_clock::now()\;"
    "protocol/plan.cpp|auto t = SteadyTime::clock::now()\;"
    "protocol/plan.cpp|auto t = Clock::now()\;"
    "protocol/plan.cpp|auto t = time(nullptr)\;"
    "protocol/plan.cpp|  %:include <thread>"
    "agent/commands/admission.cpp|auto t = SteadyTime::clock::now()\;"
    "agent/commands/admission.cpp|auto t = Clock::now()\;"
    "agent/commands/admission.cpp|auto t = decltype(steady) :: clock :: now()\;"
    "agent/commands/admission.cpp|const auto t = std::time(nullptr)\;"
    "agent/commands/admission.cpp|const auto t = time(nullptr)\;"
    "agent/commands/admission.cpp|%:include <sys/timerfd.h>"
    "agent/import/csv.cpp|clock_gettime(CLOCK_REALTIME, &t)\;"
    "agent/config/config.cpp|const auto t = std::chrono::system_clock::now()\;")
  string(REGEX MATCH "^([^|]+)[|](.+)$" whole "${wrong}")
  set(file "${CMAKE_MATCH_1}")
  set(line "${CMAKE_MATCH_2}")
  write_tree()
  file(WRITE "${WORK}/${file}" "#define H <thread>\n#include <string>\n${line}\n")
  run_layers("${WORK}")
  string(FIND "${text}" "${file}:3:" place)
  if(status EQUAL 0 OR place EQUAL -1)
    message(FATAL_ERROR "${file} may say `${line}`, or is not named:\n${text}")
  endif()
  math(EXPR count "${count} + 1")
endforeach()

run_layers("${WORK}/tests")
if(status EQUAL 0)
  message(FATAL_ERROR "a directory that is no project passes")
endif()
file(REMOVE_RECURSE "${WORK}")
message(STATUS "${count} wrong lines, each found")

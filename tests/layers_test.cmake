# Checks which module may include which, on the #include lines themselves: linking alone does not enforce it, because
# system headers are visible to all.
#   cmake -DROOT=<the project> -P tests/layers_test.cmake
# Prints every line that breaks a rule as file:line and fails. protocol/ handles bytes, agent/field/ wires and time,
# agent/commands/ admission, agent/store/ the disk, agent/uplink/ MQTT and payloads. Only agent/cli/, agent/agent.cpp
# and agent/reload.cpp may use all of them.
cmake_minimum_required(VERSION 3.25)
if(NOT IS_DIRECTORY "${ROOT}/protocol" OR NOT IS_DIRECTORY "${ROOT}/agent")
  message(FATAL_ERROR "layers: '${ROOT}' is not the project; call with -DROOT=<the project>")
endif()

# A rule consists of its files, the includes that are forbidden for them, and the reason. The first two are regular
# expressions on the path below ROOT and on the header between quotes or angle brackets.
set(rules 0)
macro(forbid files headers reason)
  math(EXPR rules "${rules} + 1")
  set(rule_${rules}_files "${files}")
  set(rule_${rules}_headers "${headers}")
  set(rule_${rules}_reason "${reason}")
endmacro()

set(mqtt "^(mqtt/|MQTT(Async|Client|Properties|ReasonCodes)|mosquitto)")
# A header with a slash or a dot in its name is not part of the C++ standard library.
set(not_standard "[/.]")
set(threads "thread|mutex|shared_mutex|condition_variable|future|stop_token|semaphore|latch|barrier|pthread\\.h|threads\\.h")
set(files_and_time "fstream|iostream|syncstream|filesystem|c?signal(\\.h)?|cstdio|stdio\\.h|ctime|time\\.h")
set(network "(net|netinet|arpa)/.*|netdb\\.h|ifaddrs\\.h|poll\\.h|sys/(socket|un|poll|select|epoll|eventfd)\\.h")
set(processes "spawn\\.h|sched\\.h|sys/(timerfd|signalfd|wait|ptrace)\\.h")
set(system "${network}|${processes}|(sys|linux|asm)/.*|unistd\\.h|fcntl\\.h|termios\\.h|dlfcn\\.h|aio\\.h|mqueue\\.h")
set(threads_and_io "^(${threads}|coroutine|${files_and_time}|${system})$")

forbid("^protocol/" "${threads_and_io}" "protocol/ has no threads, no I/O and no clock")
forbid("^protocol/value/" "^protocol/([^v]|v[^a])" "protocol/value/ sees nothing else of protocol/")
forbid("^protocol/" "${not_standard}"
       "protocol/ sees itself, tl/expected.hpp, Boost's small_vector and the standard library")
forbid("^agent/" "^protocol/(fx|mc|modbus)/" "agent/ knows protocols by protocol/catalog.h only: adding one changes nothing here")
forbid("^agent/field/" "^agent/(uplink|store|cli|agent)[/.]" "agent/field/ sees protocol, config and what may be done")
forbid("^agent/field/poll/" "${threads_and_io}" "agent/field/poll/ is pure: time is an argument")
forbid("^agent/field/" "^nlohmann/" "agent/field/ knows no JSON")
forbid("^agent/commands/" "^agent/(field|store|uplink|cli|agent)[/.]" "agent/commands/ is pure: it names what it needs as ports")
forbid("^agent/commands/" "${threads_and_io}" "agent/commands/ has no threads, no I/O and no clock")
forbid("^agent/store/" "^agent/(field|uplink|cli|agent)[/.]" "agent/store/ sees values, config and the commands' port")
forbid("^agent/store/" "^agent/commands/" "of agent/commands/ agent/store/ sees the ports of journal.h only")
forbid("^agent/store/disk/" "^agent/store/(samples/|journal/|[^/]+$)" "agent/store/disk/ does not know what the file contains")
forbid("^agent/uplink/" "^agent/(field|cli|agent)[/.]" "agent/uplink/ and agent/field/ meet in agent/agent.cpp only")
forbid("^agent/uplink/(commands|paho|payload|retained|samples)/" "^agent/uplink/(own_topics|publisher|session|status)[/.]"
       "agent/uplink/status/ and the loop see the other rooms, not the other way round")
forbid("^agent/uplink/session/" "^agent/uplink/(commands|own_topics|paho|payload|publisher|retained|samples|status)[/.]"
       "agent/uplink/session/ knows the connection only")
forbid("^agent/uplink/commands/" "^agent/uplink/(retained|samples)/" "agent/uplink/commands/ knows neither retained topics nor samples")
forbid("^agent/uplink/retained/" "^agent/uplink/(commands|samples)/" "agent/uplink/retained/ knows neither commands nor samples")
forbid("^agent/uplink/samples/" "^agent/uplink/(commands|retained)/" "agent/uplink/samples/ knows neither commands nor retained topics")
forbid("^agent/uplink/(commands|paho|payload|retained|samples|session|status)/" "^agent/uplink/sparkplug/"
       "only agent/agent.cpp sees a profile")
forbid("^agent/uplink/(profile|sparkplug)/" "^agent/uplink/(commands|own_topics|paho|publisher|status)[/.]"
       "profiles hear commands and know nothing of what becomes of them")
forbid("^agent/uplink/sparkplug/" "^agent/uplink/(retained|samples|session)/" "agent/uplink/sparkplug/ sees the port of profiles")
forbid("." "^google/protobuf" "only agent/uplink/sparkplug/ has Sparkplug's messages")
forbid("^agent/config/" "^agent/(commands|field|store|uplink|cli|agent)[/.]" "agent/config/ sees protocol and small things")
forbid("^agent/import/" "^agent/(commands|field|http|store|uplink|log|process|cli|agent)[/.]" "agent/import/ sees protocol and config")
forbid("^agent/import/" "${threads_and_io}" "agent/import/ has no threads, no I/O and no clock")
forbid("^agent/(config|remote)/" "^(${threads}|coroutine|${network}|${processes})$"
       "agent/config/ and agent/remote/ have no threads, no sockets, no timers and no processes")
forbid("^agent/(config|commands|field|http|store|uplink)/" "^agent/import/" "only agent/cli/ sees agent/import/")
forbid("^agent/((handover|log|process|text)/)?[^/]+$" "^agent/(commands|config|field|import|http|store|uplink|cli)/"
       "what every room uses must not know any of them")
forbid("^agent/(log|process|text)/" "^agent/handover/" "only rooms that talk to others see what they hand over")
forbid("^agent/text/" "^agent/" "agent/text/ sees protocol and the standard library")
forbid("^agent/remote/" "^agent/(commands|field|uplink|cli|agent)[/.]"
       "agent/remote/ sees config and the durable file of the store")
forbid("^agent/remote/" "^agent/store/" "of agent/store/ agent/remote/ sees durable_file.h only")
forbid("^agent/(config|commands|field|import|http|store|uplink|log|process)/" "^agent/remote/"
       "only agent/cli/, agent/agent.cpp and agent/reload.cpp see agent/remote/")
forbid("^agent/recorder/" "^agent/(commands|config|field|http|import|remote|store|uplink|cli|agent)[/.]"
       "agent/recorder/ sees protocol, the log and the durable file of the store")
forbid("^agent/http/" "^agent/(commands|field|store|uplink|cli|agent)[/.]"
       "agent/http/ sees the status, config and the log")
forbid("^agent/[a-z_]+/" "^agent/http/" "nothing but agent/agent.cpp sees agent/http/")
forbid("^agent/[a-z_]+/" "^agent/pair/" "nothing but agent/agent.cpp sees agent/pair/")
forbid("^agent/pair/" "^agent/(field|http|import|recorder|remote|cli|agent)[/.]"
       "agent/pair/ sees the broker, the store and the commands' journal")
forbid("^agent/pair/pair_(state|messages)" "${threads_and_io}"
       "the decisions of agent/pair/ are pure: time is an argument")
forbid("." "^microhttpd\\.h" "only agent/http/http_server.cpp knows the HTTP library")
forbid("." "^prometheus/" "only agent/http/exposition.cpp knows Prometheus' library")
forbid("." "^asio" "asio is agent/field/'s")
forbid("." "${mqtt}" "only agent/uplink/paho/ and agent/history/ know an MQTT library")
forbid("." "^libpq-fe\\.h" "only agent/history/ knows PostgreSQL")
forbid("^agent/history/" "^agent/(commands|config|field|http|import|remote|recorder|store|uplink|cli|agent)[/.]"
       "fxhistory is a program of its own: it shares the log with the agent")
forbid("^agent/([b-gi-z][a-z]*/|[^/]+$)" "^agent/history/" "the agent does not see fxhistory")
forbid("." "^(sqlite3|SQLiteCpp/)" "only agent/store/ knows SQLite")
forbid("^(protocol|agent)/" "^tests/" "the product does not know its tests")
forbid("^tests/(sim/|support/transcripts)" "^(protocol|agent)/" "the simulator shares no code with what it is to prove wrong")

# Exceptions from a module's rule: file, then header.
set(allowed
  "^protocol/value/[^ ]+ protocol/value/"
  "^protocol/([^v ]|v[^a ])[^ ]* protocol/"
  "^protocol/[^ ]+ tl/expected\\.hpp$"
  "^protocol/value/value\\.h boost/container/small_vector\\.hpp$"
  "^protocol/value/exact_number\\.h boost/multiprecision/cpp_int\\.hpp$"
  "^agent/(agent|reload)\\.(h|cpp) agent/"
  "^agent/text/[^ ]+ agent/text/"
  "^agent/line_time\\.(h|cpp) agent/config/model\\.h$"
  "^agent/field/((bus|command|link|transport)/)?[^/ ]+ asio"
  "^tests/[^ ]+ (asio|sqlite3|SQLiteCpp/)"
  "^agent/store/[^ ]+ (sqlite3\\.h|SQLiteCpp/SQLiteCpp\\.h)$"
  "^agent/store/[^ ]+ agent/commands/journal\\.h$"
  "^agent/uplink/paho/[^ ]+ (mqtt/|MQTT)"
  "^agent/history/[^ ]+ (mosquitto\\.h|libpq-fe\\.h)$"
  "^agent/remote/kept_file\\.h agent/store/disk/durable_file\\.h$"
  "^agent/config/read/(host\\.cpp arpa/inet|http\\.cpp sys/un)\\.h$"
  "^agent/config/source\\.cpp poll\\.h$"
  "^agent/recorder/recording_files\\.cpp agent/store/disk/(durable|store)_file\\.h$"
  "^agent/http/[^ ]+ agent/http/"
  "^agent/pair/[^ ]+ agent/pair/"
  "^agent/http/http_server\\.cpp microhttpd\\.h$"
  "^agent/http/exposition\\.cpp prometheus/")

# One line per include: path:line:#include "header". %: is another way to write #.
set(hash "^[[:space:]]*(#|%:)[[:space:]]*")
execute_process(
  COMMAND grep -rnoE --include=*.h --include=*.hpp --include=*.cpp --include=*.cc --include=*.inc
          "${hash}(include|import)(_next)?[[:space:]]*[\"<][^\">]+" agent protocol
  WORKING_DIRECTORY "${ROOT}" OUTPUT_VARIABLE product RESULT_VARIABLE status)
if(NOT status EQUAL 0)
  message(FATAL_ERROR "layers: no #include found under ${ROOT}")
endif()
set(tests "")
if(IS_DIRECTORY "${ROOT}/tests")
  execute_process(
    COMMAND grep -rnoE --include=*.h --include=*.hpp --include=*.cpp --include=*.cc --include=*.inc
            "${hash}(include|import)(_next)?[[:space:]]*[\"<][^\">]+" tests
    WORKING_DIRECTORY "${ROOT}" OUTPUT_VARIABLE tests)
endif()
string(REGEX REPLACE "\n+" ";" includes "${product}${tests}")
list(REMOVE_ITEM includes "")

set(broken 0)
foreach(include IN LISTS includes)
  string(REGEX MATCH "^([^:]+):([0-9]+):[^\"<]*([\"<])(.+)$" whole "${include}")
  set(file "${CMAKE_MATCH_1}")
  set(line "${CMAKE_MATCH_2}")
  set(quote "${CMAKE_MATCH_3}")
  set(header "${CMAKE_MATCH_4}")
  # A path outside of the project would escape the rules.
  if(quote STREQUAL "\"" AND NOT header MATCHES "^(protocol|agent|tests)/[^.]")
    message(NOTICE "${file}:${line}: includes ${header}: our headers are named from the root")
    math(EXPR broken "${broken} + 1")
    continue()
  endif()
  set(is_allowed FALSE)
  foreach(pair IN LISTS allowed)
    if("${file} ${header}" MATCHES "${pair}")
      set(is_allowed TRUE)
    endif()
  endforeach()
  if(is_allowed)
    continue()
  endif()
  foreach(rule RANGE 1 ${rules})
    if(file MATCHES "${rule_${rule}_files}" AND header MATCHES "${rule_${rule}_headers}")
      message(NOTICE "${file}:${line}: includes ${header}: ${rule_${rule}_reason}")
      math(EXPR broken "${broken} + 1")
      break()
    endif()
  endforeach()
endforeach()

# Lines that no rule on headers detects: an include whose header is named by a macro, and a clock that is read in code
# that should take time as an argument. Clocks by <chrono>, POSIX and C. Only source.cpp has one: a pipe as config
# file has a deadline.
function(find_lines regex where except reason)
  execute_process(COMMAND grep -rnE --include=*.h --include=*.hpp --include=*.cpp --include=*.cc --include=*.inc
                          "${regex}" ${where}
                  WORKING_DIRECTORY "${ROOT}" OUTPUT_VARIABLE lines ERROR_QUIET)
  string(REGEX MATCHALL "[^:\n]+:[0-9]+:" places "${lines}")
  list(FILTER places EXCLUDE REGEX "${except}")
  foreach(place IN LISTS places)
    message(NOTICE "${place} ${reason}")
    math(EXPR broken "${broken} + 1")
  endforeach()
  set(broken ${broken} PARENT_SCOPE)
endfunction()
find_lines("${hash}(include|import)(_next)?[[:space:]]*[^\"<[:space:]]" "agent;protocol;tests" "^$"
           "an #include names its header itself")
find_lines("[Cc]lock *>? *:: *now\\b|\\b(clock_gettime|gettimeofday|timespec_get|std::time|::time) *\\(|\\btime *\\( *(nullptr|NULL|0|&[a-z_]+) *\\)"
           "protocol;agent/commands;agent/config;agent/import;agent/remote" "^agent/config/source\\.cpp:"
           "time is an argument here")

list(LENGTH includes count)
if(broken GREATER 0)
  message(FATAL_ERROR "layers: ${broken} breaches in ${count} includes")
endif()
message(STATUS "layers: ${count} includes, ${rules} rules, none broken")

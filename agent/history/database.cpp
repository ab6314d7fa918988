#include "agent/history/database.h"

#include <poll.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <string_view>
#include <utility>

namespace fxagent::history {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::seconds kLastWait{5};  // for an answer, after a stop was requested

/// Returns a message of libpq in one line.
std::string one_line(const char* message) {
  std::string text = message == nullptr ? "" : message;
  std::ranges::replace(text, '\n', ' ');
  while (text.ends_with(' ')) text.pop_back();
  return text;
}

std::uint64_t count_at(const PGresult* result, int column) {
  return std::strtoull(PQgetvalue(result, 0, column), nullptr, 10);
}

std::string_view sqlstate_of(const PGresult* result) {
  const char* state = PQresultErrorField(result, PG_DIAG_SQLSTATE);
  return state == nullptr ? "" : state;
}

/// True for classes 22, 23 and 54 of SQLSTATE: data exceptions, violated constraints, and values
/// that are too large for the database.
bool is_wrong_data(const PGresult* result) {
  const std::string_view code = sqlstate_of(result);
  return code.starts_with("22") || code.starts_with("23") || code.starts_with("54");
}

std::string primary_message(const PGresult* result) {
  const char* text = PQresultErrorField(result, PG_DIAG_MESSAGE_PRIMARY);
  return one_line(text == nullptr ? PQresultErrorMessage(result) : text);
}

/// Returns the cure of a connection that failed. libpq has no SQLSTATE for it.
std::string cure_of_connection(const PGconn* connection, std::string_view why) {
  if (PQconnectionNeedsPassword(connection) != 0 || why.find("password") != why.npos)
    return "check the password in the file that passfile= in --database names. The file has mode "
           "0600 and belongs to the user of this process";
  // "The database system is starting up" and "sorry, too many clients already" are also FATAL.
  const bool is_busy = why.find("the database system is") != why.npos ||
                       why.find("too many") != why.npos || why.find("slots") != why.npos;
  if (why.find("FATAL:") != why.npos && !is_busy)
    return "the server refuses this user or database: check user= and dbname= in --database, and "
           "pg_hba.conf";
  return cure_of("");
}

}  // namespace

std::string cure_of(std::string_view sqlstate) {
  // Class 08: connection exceptions. 57P: the server stops or starts.
  if (sqlstate.empty() || sqlstate.starts_with("08") || sqlstate.starts_with("57P"))
    return "not reachable: start the database, and check host= and port= in --database";
  if (sqlstate == "42501")  // insufficient privilege
    return "as the owner of the database: GRANT fxhistory_writer TO the user of --database";
  // Undefined schema, table, function or column.
  if (sqlstate == "3F000" || sqlstate == "42P01" || sqlstate == "42883" || sqlstate == "42703")
    return "run schema.sql in the database of --database";
  if (sqlstate == "55P03")  // lock not available
    return "nothing: another session holds a lock, and fxhistory tries again";
  return "see the log of the database";
}

std::string fault_of_target(const std::string& target) {
  if (target.empty()) return "may not be empty";
  // libpq takes a text without "=" for the name of a database.
  if (target.find('=') == target.npos && target.find("://") == target.npos) return {};
  char* error = nullptr;
  PQconninfoOption* options = PQconninfoParse(target.c_str(), &error);
  std::string fault = one_line(error);
  if (options == nullptr && fault.empty()) fault = "libpq cannot parse it";
  PQconninfoFree(options);
  PQfreemem(error);
  return fault;
}

Database::Database(std::string target, SynchronousCommit commit, int stop,
                   std::function<void()> idle)
    : target_(std::move(target)), commit_(commit), stop_(stop), idle_(std::move(idle)) {}

bool Database::connect(DatabaseFault& fault) {
  if (connection_ && PQstatus(connection_.get()) == CONNECTION_OK) return true;
  // Values in `target_` override these. The time-outs detect a server that vanished.
  const char* const keys[] = {
      "connect_timeout",  "tcp_user_timeout",          "keepalives_idle", "keepalives_interval",
      "keepalives_count", "fallback_application_name", "dbname",          nullptr};
  const char* const values[] = {"5",         "15000",         "10",   "5", "3",
                                "fxhistory", target_.c_str(), nullptr};
  connection_.reset(PQconnectdbParams(keys, values, /*expand_dbname=*/1));
  if (PQstatus(connection_.get()) != CONNECTION_OK) {
    fault.why = one_line(PQerrorMessage(connection_.get()));
    fault.cure = cure_of_connection(connection_.get(), fault.why);
    return false;
  }
  PQsetNoticeProcessor(
      connection_.get(), [](void*, const char*) {}, nullptr);
  // Overrides a setting of the role or the database: an acknowledged sample must not be lost.
  const Result set = run("SELECT set_config('synchronous_commit', $1, false)",
                         commit_ == SynchronousCommit::on ? "on" : "off");
  if (set && PQresultStatus(set.get()) == PGRES_TUPLES_OK) return true;
  fault = fault_of(set.get());
  connection_.reset();
  return false;
}

/// Returns the fault of a statement. `result` is null if there was no answer.
DatabaseFault Database::fault_of(const PGresult* result) const {
  DatabaseFault fault{
      result == nullptr ? one_line(PQerrorMessage(connection_.get())) : primary_message(result),
      cure_of(result == nullptr ? "" : sqlstate_of(result))};
  if (fault.why.empty()) fault.why = "no answer";
  return fault;
}

Database::Result Database::run(const char* statement, const char* argument) {
  PGconn* connection = connection_.get();
  const char* const values[] = {argument};
  if (PQsendQueryParams(connection, statement, 1, nullptr, values, nullptr, nullptr, 0) == 0)
    return nullptr;
  auto deadline = Clock::time_point::max();
  Result last;
  while (true) {
    while (PQisBusy(connection) != 0) {
      const bool stops = deadline != Clock::time_point::max();
      if (stops && Clock::now() >= deadline) return nullptr;
      pollfd waited[] = {{PQsocket(connection), POLLIN, 0}, {stops ? -1 : stop_, POLLIN, 0}};
      poll(waited, 2, 1000);
      idle_();
      if (waited[1].revents != 0) deadline = Clock::now() + kLastWait;
      if (PQconsumeInput(connection) == 0) return nullptr;
    }
    Result next(PQgetResult(connection));
    if (!next) return last;
    last = std::move(next);
  }
}

Put Database::put(const std::string& batch) {
  Put out;
  if (!connect(out.fault)) return out;
  const Result result = run("SELECT stored, repeated FROM history.put($1::jsonb)", batch.c_str());
  if (result && PQresultStatus(result.get()) == PGRES_TUPLES_OK) {
    out.state = PutState::stored;
    out.stored = count_at(result.get(), 0);
    out.repeated = count_at(result.get(), 1);
  } else {
    out.fault = fault_of(result.get());
    if (result && is_wrong_data(result.get()))
      out.state = PutState::wrong_data;
    else
      connection_.reset();
  }
  return out;
}

std::optional<DatabaseFault> Database::maintain(int keep_days) {
  DatabaseFault fault;
  if (!connect(fault)) return fault;
  const std::string days = std::to_string(keep_days);
  const Result result =
      run("SELECT history.maintain(nullif($1::integer, 0) * interval '1 day')", days.c_str());
  if (result && PQresultStatus(result.get()) == PGRES_TUPLES_OK) return std::nullopt;
  fault = fault_of(result.get());
  connection_.reset();
  return fault;
}

}  // namespace fxagent::history

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

/// True for classes 22, 23 and 54 of SQLSTATE: data exceptions, violated constraints, and values
/// that are too large for the database.
bool is_wrong_data(const PGresult* result) {
  const char* state = PQresultErrorField(result, PG_DIAG_SQLSTATE);
  const std::string_view code = state == nullptr ? "" : state;
  return code.starts_with("22") || code.starts_with("23") || code.starts_with("54");
}

std::string primary_message(const PGresult* result) {
  const char* text = PQresultErrorField(result, PG_DIAG_MESSAGE_PRIMARY);
  return one_line(text == nullptr ? PQresultErrorMessage(result) : text);
}

}  // namespace

Database::Database(std::string target, SynchronousCommit commit, int stop)
    : target_(std::move(target)), commit_(commit), stop_(stop) {}

bool Database::connect(std::string& why) {
  if (connection_ && PQstatus(connection_.get()) == CONNECTION_OK) return true;
  // Values in `target_` override these. The time-outs detect a server that vanished.
  const char* const keys[] = {
      "connect_timeout",  "tcp_user_timeout",          "keepalives_idle", "keepalives_interval",
      "keepalives_count", "fallback_application_name", "dbname",          nullptr};
  const char* const values[] = {"5",         "15000",         "10",   "5", "3",
                                "fxhistory", target_.c_str(), nullptr};
  connection_.reset(PQconnectdbParams(keys, values, /*expand_dbname=*/1));
  if (PQstatus(connection_.get()) != CONNECTION_OK) {
    why = one_line(PQerrorMessage(connection_.get()));
    return false;
  }
  PQsetNoticeProcessor(
      connection_.get(), [](void*, const char*) {}, nullptr);
  // Overrides a setting of the role or the database: an acknowledged sample must not be lost.
  const Result set(PQexec(connection_.get(), commit_ == SynchronousCommit::on
                                                 ? "SET synchronous_commit TO on"
                                                 : "SET synchronous_commit TO off"));
  if (PQresultStatus(set.get()) == PGRES_COMMAND_OK) return true;
  why = one_line(PQerrorMessage(connection_.get()));
  connection_.reset();
  return false;
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
  if (!connect(out.why)) return out;
  const Result result = run("SELECT stored, repeated FROM history.put($1::jsonb)", batch.c_str());
  if (result && PQresultStatus(result.get()) == PGRES_TUPLES_OK) {
    out.state = PutState::stored;
    out.stored = count_at(result.get(), 0);
    out.repeated = count_at(result.get(), 1);
  } else if (result && is_wrong_data(result.get())) {
    out.state = PutState::wrong_data;
    out.why = primary_message(result.get());
  } else {
    out.why = result ? primary_message(result.get()) : one_line(PQerrorMessage(connection_.get()));
    if (out.why.empty()) out.why = "no answer";
    connection_.reset();
  }
  return out;
}

std::string Database::maintain(int keep_days) {
  std::string why;
  if (!connect(why)) return why;
  const std::string days = std::to_string(keep_days);
  const Result result =
      run("SELECT history.maintain(nullif($1::integer, 0) * interval '1 day')", days.c_str());
  if (result && PQresultStatus(result.get()) == PGRES_TUPLES_OK) return {};
  why = result ? primary_message(result.get()) : one_line(PQerrorMessage(connection_.get()));
  connection_.reset();
  return why.empty() ? "no answer" : why;
}

}  // namespace fxagent::history

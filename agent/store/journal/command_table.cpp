#include "agent/store/journal/command_table.h"

#include <algorithm>
#include <chrono>
#include <map>
#include <ranges>
#include <utility>

namespace fxagent {
namespace {

using sqlite::from_sql;
using sqlite::number;
using sqlite::text;
using std::chrono::milliseconds;

constexpr std::uint64_t kMostRefused = 10000;  // rows of refused commands
constexpr std::uint64_t kRefusedAtOnce = 200;
constexpr std::int64_t kShrunkAtOnce = 200;
// Rows outlive the ids in admission, which asks for their first results.
constexpr std::chrono::hours kLongerThanKnown{1};

// A later command replaces the row: admission did not know the id when it accepted that command. It
// had forgotten the id, or the file opened late.
constexpr const char* kInsert =
    "INSERT INTO orders VALUES(?, ?, ?, ?, ?, ?, ?, '', 0, ?, ?, 0)"
    " ON CONFLICT DO UPDATE SET received_ms = excluded.received_ms,"
    " deadline_ms = excluded.deadline_ms, op = excluded.op,"
    " response_topic = excluded.response_topic, correlation = excluded.correlation,"
    " result = '', told = 0, arrival = excluded.arrival, payload = excluded.payload,"
    " refused = 0"
    " WHERE arrival < excluded.arrival";
constexpr const char* kRecord =
    "INSERT INTO orders VALUES(?, ?, ?, ?, ?, ?, ?, ?, 0, ?, '', ?)"
    " ON CONFLICT DO UPDATE SET"
    " received_ms = iif(arrival = excluded.arrival, received_ms, excluded.received_ms),"
    " deadline_ms = max(deadline_ms, excluded.deadline_ms), op = excluded.op,"
    " response_topic = iif(arrival = excluded.arrival, response_topic,"
    " excluded.response_topic),"
    " correlation = iif(arrival = excluded.arrival, correlation, excluded.correlation),"
    " result = excluded.result, told = 0, arrival = excluded.arrival, payload = '',"
    " refused = iif(arrival = excluded.arrival, refused, excluded.refused)"
    " WHERE iif(result = '', arrival <= excluded.arrival, arrival < excluded.arrival)";

// Bytes of a row: its texts, and 200 for the row itself and its index entries.
constexpr const char* kCost =
    "(200 + length(CAST(device AS BLOB)) + 2 * length(CAST(id AS BLOB))"
    " + length(CAST(op AS BLOB)) + length(CAST(response_topic AS BLOB)) + length(correlation)"
    " + length(CAST(result AS BLOB)) + length(CAST(payload AS BLOB)))";

// Place of a row among those of its device; the newest has 1.
constexpr const char* kPlace =
    "row_number() OVER (PARTITION BY device ORDER BY arrival DESC, received_ms DESC) AS place";

constexpr const char* kFind =
    "SELECT device, id, received_ms, deadline_ms, op, response_topic, correlation, result, told,"
    " arrival, payload, refused FROM orders WHERE device = ? AND id = ?";

std::int64_t moment(std::int64_t utc_ms) { return std::clamp<std::int64_t>(utc_ms, 0, kLatestMs); }

/// Returns the entry in the row of kFind.
JournalEntry entry_of(const SQLite::Statement& row) {
  JournalEntry entry;
  entry.device = text(row, 0);
  entry.id = text(row, 1);
  entry.received_ms = moment(number(row, 2));
  entry.deadline_ms = moment(number(row, 3));
  entry.op = text(row, 4);
  entry.response_topic = text(row, 5);
  const ByteView correlation = sqlite::bytes(row, 6);
  entry.correlation.assign(correlation.begin(), correlation.end());
  entry.result = text(row, 7);
  entry.acknowledged = number(row, 8) != 0;
  entry.number = from_sql(number(row, 9));
  // The place follows the command, whose text ends with a brace or white space.
  const std::string_view payload = text(row, 10);
  const std::size_t end = payload.find_last_of("} \t\r\n") + 1;  // npos + 1 is 0
  entry.payload = payload.substr(0, end);
  entry.place = payload.substr(end);
  entry.refused = number(row, 11) != 0;
  return entry;
}

}  // namespace

CommandTable::CommandTable(SQLite::Database& database)
    : database_(database),
      insert_(database, kInsert),
      record_(database, kRecord),
      find_(database, kFind),
      acknowledge_(database,
                   "UPDATE orders SET told = 1, response_topic = '', correlation = x'',"
                   " result = replace(result, ?, ?)"
                   " WHERE device = ? AND id = ? AND arrival = ?"),
      cost_(database,
            std::string("SELECT ") + kCost + ", refused FROM orders WHERE device = ? AND id = ?"),
      drop_refused_(database,
                    std::string("DELETE FROM orders WHERE (device, id) IN (SELECT device, id"
                                " FROM orders WHERE refused = 1 ORDER BY arrival LIMIT ?)"
                                " RETURNING ") +
                        kCost),
      size_(measure()),
      changed_(size_) {}

/// Runs once at the start, and after deletions of many rows.
CommandTable::Size CommandTable::measure() {
  Size size;
  SQLite::Statement sum(
      database_, std::string("SELECT count(*), total(") + kCost + "), total(refused) FROM orders");
  sqlite::each(sum, [&](const SQLite::Statement& row) {
    size = {from_sql(number(row, 0)), from_sql(number(row, 1)), from_sql(number(row, 2))};
  });
  return size;
}

CommandTable::Size CommandTable::size_of(const std::string& device, const std::string& id) {
  Size size;
  const auto take = [&](const SQLite::Statement& row) {
    size = {1, from_sql(number(row, 0)), number(row, 1) != 0 ? 1U : 0U};
  };
  sqlite::each(cost_, take, device, id);
  return size;
}

/// Runs a change of one row and counts its effect.
void CommandTable::change(const std::string& device, const std::string& id,
                          const std::function<void()>& work) {
  ++changes_since_trim_;
  const Size before = size_of(device, id);
  work();
  const Size after = size_of(device, id);
  changed_.rows += after.rows - before.rows;
  changed_.bytes += after.bytes - before.bytes;
  changed_.refused += after.refused - before.refused;
}

void CommandTable::insert(const JournalEntry& entry) {
  change(entry.device, entry.id, [&] {
    sqlite::run(insert_, entry.device, entry.id, entry.received_ms, entry.deadline_ms, entry.op,
                entry.response_topic, ByteView(entry.correlation), entry.number,
                entry.payload + entry.place);
  });
}

void CommandTable::record(const JournalEntry& entry) {
  if (entry.refused) make_room_for_refused();
  change(entry.device, entry.id, [&] {
    sqlite::run(record_, entry.device, entry.id, entry.received_ms, entry.deadline_ms, entry.op,
                entry.response_topic, ByteView(entry.correlation), entry.result, entry.number,
                entry.refused);
  });
}

/// Deletes the oldest refused commands: a flood of them must not fill the file.
void CommandTable::make_room_for_refused() {
  if (changed_.refused < kMostRefused) return;
  const auto take = [this](const SQLite::Statement& row) {
    --changed_.rows;
    --changed_.refused;
    changed_.bytes -= from_sql(number(row, 0));
  };
  sqlite::each(drop_refused_, take, kRefusedAtOnce);
}

void CommandTable::acknowledge(const std::string& device, const std::string& id,
                               std::uint64_t command_number, const std::string& total_ms) {
  change(device, id, [&] {
    const std::string unknown(kNoTotal);
    sqlite::run(acknowledge_, unknown, with_total(unknown, total_ms), device, id, command_number);
  });
}

std::optional<JournalEntry> CommandTable::find(const std::string& device, const std::string& id) {
  std::optional<JournalEntry> found;
  sqlite::each(
      find_, [&](const SQLite::Statement& row) { found = entry_of(row); }, device, id);
  return found;
}

/// Returns the ids of the rows that meet `condition`, oldest first. Sorts them here: SQLite would
/// sort many of them in a temporary file, for which a full disk has no room.
std::vector<KnownId> CommandTable::ids_where(const std::string& condition,
                                             const std::string& device) {
  std::vector<KnownId> ids;
  const auto take = [&](const SQLite::Statement& row) {
    ids.push_back({std::string(text(row, 0)), std::string(text(row, 1)), from_sql(number(row, 2)),
                   moment(number(row, 3)), moment(number(row, 4)), number(row, 5) != 0});
  };
  // For one device the primary key limits the search to its rows.
  SQLite::Statement wanted(
      database_,
      "SELECT device, id, arrival, received_ms, deadline_ms, refused FROM orders WHERE (" +
          condition + ") AND " + (device.empty() ? "?1 = ''" : "device = ?1"));
  sqlite::each(wanted, take, device);
  std::ranges::stable_sort(ids, {},
                           [](const KnownId& id) { return std::pair(id.number, id.received_ms); });
  return ids;
}

std::vector<KnownId> CommandTable::known_ids(const std::string& device) {
  return ids_where("result IS NOT '' OR told IS 1", device);
}

std::vector<JournalEntry> CommandTable::unacknowledged(const std::string& device) {
  std::vector<JournalEntry> entries;
  std::map<std::string, std::size_t> newer;  // by device
  for (const KnownId& id : ids_where("told IS NOT 1", device) | std::views::reverse) {
    auto entry = find(id.device, id.id);
    const bool is_surplus = ++newer[id.device] > kRememberedIds;
    if (entry && (entry->result.empty() || !is_surplus)) entries.push_back(*std::move(entry));
  }
  std::ranges::reverse(entries);
  return entries;
}

bool CommandTable::shrink() {
  SQLite::Statement oldest(
      database_,
      "SELECT device, id FROM orders WHERE refused = 1 OR told = 1 AND result <> ''"
      " ORDER BY refused DESC, arrival LIMIT ?");
  SQLite::Statement remove(database_,
                           "DELETE FROM orders WHERE device = ? AND id = ? AND refused = 1");
  SQLite::Statement clear(database_, "UPDATE orders SET result = '' WHERE device = ? AND id = ?");
  std::vector<std::pair<std::string, std::string>> found;
  sqlite::each(
      oldest, [&](const SQLite::Statement& row) { found.emplace_back(text(row, 0), text(row, 1)); },
      kShrunkAtOnce);
  for (const auto& [device, id] : found)
    change(device, id, [&, of = &device, which = &id] {
      sqlite::run(remove, *of, *which);
      sqlite::run(clear, *of, *which);
    });
  return !found.empty();
}

void CommandTable::drop_old(std::int64_t utc_ms, std::int64_t max_age_ms) {
  const std::int64_t day = milliseconds(kRememberedFor + kLongerThanKnown).count();
  const std::int64_t age = std::max(day, max_age_ms);
  // Unacknowledged results are kept as long as samples.
  SQLite::Statement old(database_,
                        "DELETE FROM orders WHERE deadline_ms < ?1"
                        " AND (told = 1 AND received_ms < ?2 OR received_ms < ?3)");
  // The newest kRememberedIds commands of each device keep their first results. Beyond them only
  // ids stay, at most kFingerprints of all devices.
  SQLite::Statement results(
      database_,
      std::string("UPDATE orders SET result = '' WHERE told = 1 AND result <> '' AND (device, id)"
                  " IN (SELECT device, id FROM (SELECT device, id, ") +
          kPlace + " FROM orders) WHERE place > ?1)");
  SQLite::Statement many(
      database_,
      "DELETE FROM orders WHERE told = 1 AND result = '' AND deadline_ms < ?1 AND (device, id) IN"
      " (SELECT device, id FROM orders WHERE told = 1 AND result = ''"
      " ORDER BY arrival DESC, received_ms DESC LIMIT -1 OFFSET ?2)");
  // If the broker never acknowledges results, they must not fill the disk.
  SQLite::Statement unacknowledged(
      database_, std::string("DELETE FROM orders WHERE deadline_ms < ?1 AND (device, id) IN"
                             " (SELECT device, id FROM (SELECT device, id, ") +
                     kPlace + " FROM orders WHERE told = 0 AND result <> '') WHERE place > ?2)");
  int changes = sqlite::run(old, utc_ms, utc_ms - day, utc_ms - age);
  // The search for surplus rows reads all of them: half a second for 200,000. Few rows need no
  // search; with very many it waits until a tenth of them are new.
  const bool very_many = size_.rows > 2 * kRememberedIds;
  if (size_.rows > kRememberedIds && (!very_many || changes_since_trim_ > size_.rows / 10)) {
    changes += sqlite::run(results, kRememberedIds);
    changes += sqlite::run(many, utc_ms, kFingerprints);
    changes += sqlite::run(unacknowledged, utc_ms, kRememberedIds);
    changes_since_trim_ = 0;
  }
  if (changes != 0) changed_ = measure();
}

void CommandTable::move_times(std::int64_t by_ms, std::uint64_t from_number, std::int64_t from_ms,
                              std::int64_t to_ms) {
  SQLite::Statement move(database_,
                         "UPDATE orders SET received_ms = received_ms + ?1,"
                         " deadline_ms = deadline_ms + ?1"
                         " WHERE received_ms <= ?4 AND (arrival >= ?2 OR received_ms >= ?3)");
  sqlite::run(move, by_ms, from_number, from_ms, to_ms);
}

void CommandTable::age_acknowledged(std::uint64_t from_number) {
  SQLite::Statement older(database_,
                          "UPDATE orders SET arrival = 0 WHERE told = 1 AND arrival >= ?");
  sqlite::run(older, from_number);
}

}  // namespace fxagent

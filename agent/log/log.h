// One event a line on stderr, key=value: `ts level event key=value …`. Any thread.
#pragma once

#include <cstddef>
#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>

namespace fxagent::log {

enum class Level { debug, info, warn, error };

/// A key and its value; values with blanks or quotes are quoted; control characters and what is
/// not UTF-8 are escaped byte by byte; of more than 1,024 bytes only those are written.
using Field = std::pair<std::string_view, std::string>;

/// Of a text that comes from others, so much is logged.
inline constexpr std::size_t kMostForeignBytes = 128;

/// The beginning of a text that comes from others, whole characters of at most 128 bytes, and
/// behind it how long it is where that is more. The field of a line escapes it.
std::string excerpt(std::string_view foreign);

/// Sets what is written: `info` and above at first.
void set_level(Level level);

/// The text after time and level: `event key=value key="value with blanks"`.
std::string format_line(std::string_view event, std::initializer_list<Field> fields);

/// While it lives, lines go to stderr through a thread of their own and nobody waits for a reader;
/// of equal lines five are written in 10 s, and the rest is counted: `repeated count=… line="…"`;
/// lines that find no room are counted too: `log_lines_dropped count=…`. Its end, and a
/// std::terminate, write what waits, for at most a second. One at a time. Throws std::system_error
/// where there is no thread; without one each line is written by who logs it.
class InBackground final {
 public:
  InBackground();
  ~InBackground();
  InBackground(const InBackground&) = delete;
  InBackground& operator=(const InBackground&) = delete;
};

void debug(std::string_view event, std::initializer_list<Field> fields = {});
void info(std::string_view event, std::initializer_list<Field> fields = {});
void warn(std::string_view event, std::initializer_list<Field> fields = {});
void error(std::string_view event, std::initializer_list<Field> fields = {});

}  // namespace fxagent::log

// One event a line on stderr, key=value: `ts level event key=value …`. Any thread.
#pragma once

#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>

namespace fxagent::log {

enum class Level { debug, info, warn, error };

/// A key and its value; values with blanks or quotes are quoted; control characters and what is
/// not UTF-8 are escaped byte by byte.
using Field = std::pair<std::string_view, std::string>;

/// Sets what is written: `info` and above at first.
void set_level(Level level);

/// The text after time and level: `event key=value key="value with blanks"`.
std::string format_line(std::string_view event, std::initializer_list<Field> fields);

void debug(std::string_view event, std::initializer_list<Field> fields = {});
void info(std::string_view event, std::initializer_list<Field> fields = {});
void warn(std::string_view event, std::initializer_list<Field> fields = {});
void error(std::string_view event, std::initializer_list<Field> fields = {});

}  // namespace fxagent::log

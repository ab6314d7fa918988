#include "agent/text/json_writer.h"

namespace fxagent::json {
namespace {

void write_scalar(Writer& out, const Scalar& scalar, Precision precision) {
  if (const auto* flag = std::get_if<bool>(&scalar))
    out.boolean(*flag);
  else if (const auto* integer = std::get_if<std::int64_t>(&scalar))
    out.integer(*integer);
  else if (const auto* real = std::get_if<double>(&scalar))
    precision == Precision::single ? out.number(static_cast<float>(*real)) : out.number(*real);
  else if (const auto* large = std::get_if<BigInteger>(&scalar))
    out.string(large->digits);
  else
    out.string(std::get<std::string>(scalar));
}

}  // namespace

void write_value(Writer& out, const Value& value, Precision precision) {
  if (value.is_array) {
    out.begin_array();
    for (const Scalar& item : value.items) write_scalar(out, item, precision);
    out.end_array();
  } else if (value.items.empty()) {
    out.null();
  } else {
    write_scalar(out, value.items.front(), precision);
  }
}

void write_optional(Writer& out, const std::optional<Value>& value) {
  value ? write_value(out, *value) : static_cast<void>(out.null());
}

bool may_stand_inside(std::string_view json) {
  return !json.starts_with('\xEF') && json.find('\0') == std::string_view::npos;
}

}  // namespace fxagent::json

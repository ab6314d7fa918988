#include "agent/cli/report/read_report.h"

#include <algorithm>
#include <cmath>

#include "agent/cli/report/layout.h"
#include "agent/text/json_writer.h"
#include "protocol/value/pack.h"
#include "protocol/value/value.h"

namespace fxagent {
namespace {

using json::Writer;

std::string scalar_text(const Scalar& scalar) {
  if (const auto* flag = std::get_if<bool>(&scalar)) return *flag ? "true" : "false";
  if (!std::holds_alternative<std::string>(scalar)) return spelled(scalar);
  Writer out;
  write_value(out, Value(scalar));
  return out.take();
}

/// Returns the label of an integer or bool; null if it has none.
const std::string* label_of(const Scalar& scalar, const TagStates& states) {
  for (const auto& [value, label] : states)
    if (compare(scalar, Scalar(value)) == std::partial_ordering::equivalent) return &label;
  return nullptr;
}

std::string no_value_text(const ReadReport& report) {
  return report.reason + (report.detail.empty() ? "" : ": " + report.detail);
}

Row order_row(const ReadReport& report) {
  Row row{report.name, report.address, ""};
  if (!report.point || report.image.empty()) {
    row.push_back(report.value ? value_text(*report.value, *no_units()) : no_value_text(report));
    row.resize(3 + report.orders.size());
    return row;
  }
  row[2] = to_string(report.point->type);
  for (const ByteOrder order : report.orders) {
    const auto value = in_order(*report.point, report.image, order);
    row.push_back((value ? value_text(*value, *no_units()) : "-") +
                  (order == report.point->order ? "*" : ""));
  }
  return row;
}

void write_items(Writer& out, const Value& value) { write_value(out, Value::array(value.items)); }

void write_report(Writer& out, const ReadReport& report, ShowOrders orders) {
  out.begin_object().key("name").string(report.name);
  out.key("address").word(report.address);
  out.key("unit").string(report.units->unit);
  if (report.value) {
    out.key("values");
    write_items(out, *report.value);
  } else {
    out.key("reason").string(report.reason).key("detail").string(report.detail);
  }
  if (orders == ShowOrders::yes && report.point && !report.image.empty()) {
    out.key("type").string(to_string(report.point->type));
    out.key("orders").begin_object();
    for (const ByteOrder order : report.orders) {
      out.key(to_string(order));
      const auto value = in_order(*report.point, report.image, order);
      value ? write_items(out, *value) : static_cast<void>(out.null());
    }
    out.end_object();
  }
  if (const std::string hint = hint_of(report); !hint.empty()) out.key("hint").string(hint);
  out.end_object();
}

}  // namespace

bool has_word_order(const Point& point) {
  const auto span = span_of(point);
  return span && point.address.unit == Unit::word && point.type != DataType::string &&
         span->bits / point.count > kWordBits;
}

Result<Value> in_order(Point point, ByteView image, ByteOrder order) {
  point.order = order;
  return unpack(point, image, point.address.span.first_bit);
}

std::string value_text(const Value& value, const TagUnits& units) {
  std::string text;
  for (const Scalar& item : value.items) {
    text += (text.empty() ? "" : ", ") + scalar_text(item);
    if (const std::string* label = label_of(item, units.states)) text += " (" + *label + ")";
  }
  if (value.is_array) text = "[" + text + "]";
  return units.unit.empty() ? text : text + " " + units.unit;
}

std::string hint_of(const ReadReport& report) {
  if (!report.point || report.image.empty()) return {};
  const Point& point = *report.point;
  const std::string hint =
      word_order_hint(point, report.orders, read_from(report.image, point.address.span.first_bit));
  return hint.empty() ? hint : report.name + ": " + hint;
}

std::string read_table(std::span<const ReadReport> reports, ShowOrders orders) {
  std::vector<Row> rows;
  if (orders == ShowOrders::yes && !reports.empty()) {
    rows.push_back({"name", "address", "type"});
    for (const ByteOrder order : reports.front().orders)
      rows.front().emplace_back(to_string(order));
  }
  for (const ReadReport& report : reports)
    rows.push_back(
        orders == ShowOrders::yes
            ? order_row(report)
            : Row{report.name, report.address,
                  report.value ? value_text(*report.value, *report.units) : no_value_text(report)});
  std::string text = table_text(rows, 3);
  for (const ReadReport& report : reports)
    if (const std::string hint = hint_of(report); !hint.empty()) text += "hint: " + hint + "\n";
  return text;
}

std::string read_json(const std::string& device, std::span<const ReadReport> reports,
                      ShowOrders orders, double ms) {
  Writer out;
  out.begin_object().key("ok").boolean(std::ranges::all_of(
      reports, [](const ReadReport& report) { return report.value.has_value(); }));
  out.key("device").string(device);
  out.key("tags").begin_array();
  for (const ReadReport& report : reports) write_report(out, report, orders);
  out.end_array();
  out.key("ms").number(ms).end_object();
  return out.take();
}

}  // namespace fxagent

/* Tables among the FMU's resources: a column of a CSV file below its header. */

#ifndef TABLES_H
#define TABLES_H

/* A whole file in memory of its own, with a zero at its end; NULL if it cannot be read. */
static char *file_text(const char *path) {
    FILE *file = fopen(path, "rb");
    char *text = NULL;
    size_t size = 0, room = 0, got = 1;
    while (file && got) {
        if (size + 1 >= room) {
            char *larger = (char *)realloc(text, room = 2 * room + 65536);
            if (!larger) {
                break;
            }
            text = larger;
        }
        got = fread(text + size, 1, room - size - 1, file);
        size += got;
    }
    if (file && (got || ferror(file))) {
        free(text);
        text = NULL;
    }
    if (file) {
        fclose(file);
    }
    if (text) {
        text[size] = 0;
    }
    return text;
}

/* A plain decimal number that fills a cell but for blanks, whatever the locale. */
static int cell_number(const char *cell, size_t length, double *value) {
    char copy[80], *end;
    const char *point = localeconv()->decimal_point;
    size_t k, n = 0;
    for (k = 0; k < length && n + 8 < sizeof copy; k++) {
        if (cell[k] == '.') {
            n += (size_t)sprintf(copy + n, "%.7s", point);
        } else if (strchr("0123456789+-eE \t", cell[k])) {
            copy[n++] = cell[k];
        } else {
            return 0;
        }
    }
    copy[n] = 0;
    *value = strtod(copy, &end);
    return k == length && end != copy && strspn(end, " \t") == strlen(end) && isfinite(*value);
}

/* Reads a column into memory of its own; 0 and a reason if it cannot. */
static int read_column(char *text, int column, py_array *into, char reason[120]) {
    size_t rows = 0, row = 0;
    char *line, *c;
    for (c = text; *c; c++) {
        rows += *c == '\n';
    }
    into->at = (double *)malloc((rows + 2) * sizeof(double));
    into->length = 0;
    for (line = text; into->at && *line; row++) {
        size_t length = strcspn(line, "\n"), cell;
        char *next = line + length + (line[length] == '\n');
        int k = column;
        length -= length && line[length - 1] == '\r';
        for (c = line; k && c < line + length; c++) {
            k -= *c == ',';
        }
        cell = k ? 0 : strcspn(c, ",\r\n");
        if (row && (k || !cell_number(c, cell, into->at + into->length++))) {
            sprintf(reason, "row %lu, column %d: '%.*s' is no number", (unsigned long)row + 1, column + 1,
                    cell < 40 ? (int)cell : 40, c);
            return 0;
        }
        line = next;
    }
    strcpy(reason, into->at ? "it has no rows below its header" : "there is not enough memory");
    return into->length > 0;
}

/* Reads the tables that the model needs, once for each instance. */
static Status load_tables(Instance *I) {
    const char *const folder = I->resources ? I->resources : ".";
    int k;
    for (k = 0; k < N_TABLES; k++) {
        char reason[120] = "there is no such file", *path, *text;
        const char *file = model_table_files[k];
        py_array *table = I->model.tables + k;
        if (table->at) {
            continue;
        }
        path = (char *)malloc(strlen(folder) + strlen(file) + 2);
        if (path) {
            sprintf(path, "%s/%s", folder, file);
        }
        text = path ? file_text(path) : NULL;
        free(path);
        if (!text || !read_column(text, model_table_columns[k], table, reason)) {
            free(text);
            free(table->at);
            table->at = NULL;
            table->length = 0;
            return refuse(I, "initialisation failed: %s cannot be read: %s", file, reason);
        }
        free(text);
    }
    return STATUS_OK;
}

static void free_tables(Instance *I) {
    int k;
    for (k = 0; k < N_TABLES; k++) {
        free(I->model.tables[k].at);
    }
}

#endif
